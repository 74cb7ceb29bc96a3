// The two kernels of bench_highway with Google Highway.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/highway/theirs.cpp"
// Highway requires foreach_target.h first: it includes this file once for each target.
#include <hwy/foreach_target.h>
// clang-format off
#include <hwy/highway.h>
#include "tests/bench/highway/kernels.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace hord::bench::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out) {
    const hn::CappedTag<float, kLanes> d;
    const std::size_t n = hn::Lanes(d);
    // Sixteen lanes need up to four vectors; Highway's vectors cannot be elements of an array.
    auto x0 = hn::Zero(d), x1 = x0, x2 = x0, x3 = x0;
    const auto tiny = hn::Set(d, 1e-30F);
    const auto term = [&](const float* from_a, const float* from_b) HWY_ATTR {
        const auto p = hn::LoadU(d, from_a), q = hn::LoadU(d, from_b), e = hn::Sub(p, q);
        return hn::Div(hn::Mul(e, e), hn::Add(hn::Add(p, q), tiny));
    };
    for (std::size_t w = 0; w < lit.size(); ++w) {
        for (std::uint64_t rest = lit[w]; rest != 0; rest &= rest - 1) {
            const std::size_t at = (w * 64 + static_cast<std::size_t>(__builtin_ctzll(rest))) * stride;
            const float *p = a + at, *q = b + at;
            x0 = hn::Add(x0, term(p, q));
            if (n <= 8) x1 = hn::Add(x1, term(p + n, q + n));
            if (n <= 4) {
                x2 = hn::Add(x2, term(p + 2 * n, q + 2 * n));
                x3 = hn::Add(x3, term(p + 3 * n, q + 3 * n));
            }
        }
    }
    hn::StoreU(x0, d, out);
    if (n <= 8) hn::StoreU(x1, d, out + n);
    if (n <= 4) {
        hn::StoreU(x2, d, out + 2 * n);
        hn::StoreU(x3, d, out + 3 * n);
    }
}

int cheapest(const float* cost, const float* v, float u, int rows, float* value) {
    const hn::CappedTag<float, kLanes> d;
    const hn::RebindToSigned<decltype(d)> di;
    const std::size_t n = hn::Lanes(d);
    float values[kLanes], least = 1e30F;
    std::int32_t rows_of[kLanes];
    for (std::size_t first = 0; first < kLanes; first += n) {
        auto best = hn::Set(d, 1e30F);
        auto row = hn::Zero(di);
        const auto of_columns = hn::LoadU(d, v + first), of_rows = hn::Set(d, u);
        for (int r = 0; r < rows; ++r) {
            const auto reduced = hn::Sub(hn::Sub(hn::LoadU(d, cost + r * kLanes + first), of_rows), of_columns);
            row = hn::IfThenElse(hn::RebindMask(di, hn::Lt(reduced, best)), hn::Set(di, r), row);
            best = hn::Min(best, reduced);
        }
        hn::StoreU(best, d, values + first);
        hn::StoreU(row, di, rows_of + first);
        const float low = hn::GetLane(hn::MinOfLanes(d, best));
        least = low < least ? low : least;
    }
    *value = least;
    return first_of(values, rows_of, least);
}

}  // namespace hord::bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace hord::bench {

HWY_EXPORT(chi2);
HWY_EXPORT(cheapest);

void highway_chi2(const float* a, const float* b, std::size_t stride, const Lit& lit, float* out) {
    HWY_DYNAMIC_DISPATCH(chi2)(a, b, stride, lit, out);
}
int highway_cheapest(const float* cost, const float* v, float u, int rows, float* value) {
    return HWY_DYNAMIC_DISPATCH(cheapest)(cost, v, u, rows, value);
}
void choose_highway_target(std::int64_t target) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace hord::bench
#endif
