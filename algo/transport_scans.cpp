#include "algo/transport_scans.h"

#include <bit>
#include <limits>

#include "algo/isa_targets.h"

namespace hord::algo {
namespace {

// Eight lanes, in as many vectors as the instruction set needs.
template <int Bytes>
struct Lanes {
    using V = Vector<double, Bytes>;
    static constexpr int kEach = Bytes / static_cast<int>(sizeof(double));
    static constexpr int kParts = kScanLanes / kEach;
    V part[kParts];

    HORD_ALWAYS_INLINE void fill(double value) {
        for (auto& p : part) p = V{} + value;
    }
    HORD_ALWAYS_INLINE double least() const {
        double v[kScanLanes];
        for (int p = 0; p < kParts; ++p) store(part[p], v + p * kEach);
        return lower(lower(lower(v[0], v[4]), lower(v[2], v[6])), lower(lower(v[1], v[5]), lower(v[3], v[7])));
    }
    HORD_ALWAYS_INLINE double sum() const {
        double v[kScanLanes];
        for (int p = 0; p < kParts; ++p) store(part[p], v + p * kEach);
        return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE double gather_body(const double* table, const std::uint8_t* bin, int count, int stride, const double* weight,
                                      double share, double* cost, double* mean) {
    using L = Lanes<Bytes>;
    using V = typename L::V;
    for (int j = 0; j < count; ++j) cost[j] = table[bin[j]];
    for (int j = count; j < stride; ++j) cost[j] = kPadding;
    L sum;
    sum.fill(0);
    for (int j = 0; j < stride; j += kScanLanes) {
        for (int p = 0; p < L::kParts; ++p) {
            const int at = j + p * L::kEach;
            const V c = load<V>(cost + at);
            sum.part[p] += c * load<V>(weight + at);
            store<V>(load<V>(mean + at) + c * share, mean + at);
        }
    }
    return sum.sum();
}

template <int Bytes>
HORD_ALWAYS_INLINE void keys_body(const double* cost, const double* mean, double mean_row, int row, int stride, double* key) {
    for (int j = 0; j < stride; ++j) {
        const auto bits = std::bit_cast<std::uint64_t>(cost[j] - mean_row - mean[j]);
        key[j] = std::bit_cast<double>((bits & ~std::uint64_t{0xFFFF}) | (static_cast<std::uint64_t>(row) * 256 + static_cast<std::uint64_t>(j)));
    }
}

template <int Bytes>
HORD_ALWAYS_INLINE double least_body(const double* key, const double* shut, int stride) {
    using L = Lanes<Bytes>;
    using V = typename L::V;
    L least;
    least.fill(std::numeric_limits<double>::infinity());
    for (int j = 0; j < stride; j += kScanLanes) {
        for (int p = 0; p < L::kParts; ++p) {
            const int at = j + p * L::kEach;
            least.part[p] = lower<V>(least.part[p], load<V>(key + at) + load<V>(shut + at));
        }
    }
    return least.least();
}

template <int Bytes>
HORD_ALWAYS_INLINE double least_reduced_body(const double* cost, const double* u, const double* v, int first, int last, int stride, int* row) {
    using L = Lanes<Bytes>;
    using V = typename L::V;
    double best = 0;
    for (int i = first; i < last; ++i) {
        const double* c = cost + i * stride;
        L least;
        for (int p = 0; p < L::kParts; ++p) least.part[p] = load<V>(c + p * L::kEach) - load<V>(v + p * L::kEach);
        for (int j = kScanLanes; j < stride; j += kScanLanes) {
            for (int p = 0; p < L::kParts; ++p) {
                const int at = j + p * L::kEach;
                least.part[p] = lower<V>(least.part[p], load<V>(c + at) - load<V>(v + at));
            }
        }
        const double of_row = least.least() - u[i];
        *row = of_row < best ? i : *row;
        best = lower(best, of_row);
    }
    return best;
}

HORD_FOR_EACH_ISA(gather, double, gather_body,
                  (const double* table, const std::uint8_t* bin, int count, int stride, const double* weight, double share,
                   double* cost, double* mean),
                  (table, bin, count, stride, weight, share, cost, mean))
HORD_FOR_EACH_ISA(keys, void, keys_body, (const double* cost, const double* mean, double mean_row, int row, int stride, double* key),
                  (cost, mean, mean_row, row, stride, key))
HORD_FOR_EACH_ISA(least, double, least_body, (const double* key, const double* shut, int stride), (key, shut, stride))
HORD_FOR_EACH_ISA(least_reduced, double, least_reduced_body,
                  (const double* cost, const double* u, const double* v, int first, int last, int stride, int* row),
                  (cost, u, v, first, last, stride, row))

}  // namespace

TransportScans transport_scans(Isa isa) { return {gather(isa), keys(isa), least(isa), least_reduced(isa)}; }

}  // namespace hord::algo
