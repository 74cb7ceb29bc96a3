// The two kernels of bench_highway with algo/simd.
#include "algo/simd/multiversion.h"
#include "algo/simd/vec.h"
#include "tests/bench/highway/kernels.h"

namespace hord::algo {
namespace {

constexpr int kLanes = bench::kLanes;
using bench::Lit;

template <int Bytes>
HORD_ALWAYS_INLINE void chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out) {
    using Floats = Vec<float, kLanes, Bytes>;
    Floats sum = Floats::broadcast(0);
    const Floats tiny = Floats::broadcast(1e-30F);
    for (std::size_t w = 0; w < lit.size(); ++w) {
        for (std::uint64_t rest = lit[w]; rest != 0; rest &= rest - 1) {
            const std::size_t at = (w * 64 + static_cast<std::size_t>(__builtin_ctzll(rest))) * stride;
            const Floats p = Floats::load(a + at), q = Floats::load(b + at), d = p - q;
            const Floats above = d * d, below = p + q + tiny;
            Floats term{};
            for (std::size_t k = 0; k < std::size(term.part); ++k) term.part[k] = above.part[k] / below.part[k];
            sum = sum + term;
        }
    }
    sum.store(out);
}

template <int Bytes>
HORD_ALWAYS_INLINE int cheapest(const float* cost, const float* v, float u, int rows, float* value) {
    using Floats = Vec<float, kLanes, Bytes>;
    using Ints = Vec<std::int32_t, kLanes, Bytes>;
    Floats best = Floats::broadcast(1e30F);
    Ints row = Ints::broadcast(0);
    const Floats of_columns = Floats::load(v), of_rows = Floats::broadcast(u);
    for (int r = 0; r < rows; ++r) {
        const Floats reduced = Floats::load(cost + r * kLanes) - of_rows - of_columns;
        row = select(reduced.less_than(best), Ints::broadcast(r), row);
        best = min(best, reduced);
    }
    float values[kLanes];
    std::int32_t rows_of[kLanes];
    best.store(values);
    row.store(rows_of);
    *value = best.reduce_min();
    return bench::first_of(values, rows_of, *value);
}

HORD_FOR_EACH_ISA(chi2_for, chi2)
HORD_FOR_EACH_ISA(cheapest_for, cheapest)

}  // namespace
}  // namespace hord::algo

namespace hord::bench {

void ours_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out, algo::Isa isa) {
    algo::chi2_for(isa)(a, b, stride, lit, out);
}
int ours_cheapest(const float* cost, const float* v, float u, int rows, float* value, algo::Isa isa) {
    return algo::cheapest_for(isa)(cost, v, u, rows, value);
}

}  // namespace hord::bench
