#include "algo/emd/knapsack_batch.h"

#include <cstring>
#include <limits>

#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

constexpr int kCols = kMaxKnapsackBins - 1;  // at least one bin is a row
// Low bits of a key that hold the column: as in transport_batch.cpp, so that tied columns are served in the same order.
constexpr std::int32_t kColumnBits = 0xFF;

// kBatchLanes problems, one per lane.
template <int Bytes>
struct Knapsacks {
    using Floats = Vec<float, kBatchLanes, Bytes>;
    using Ints = Vec<std::int32_t, kBatchLanes, Bytes>;
    using Doubles = Vec<double, kBatchLanes, Bytes>;

    const TransportBatchCosts& costs;
    std::int32_t denominator[kBatchLanes];
    Ints excess[kMaxKnapsackBins], bin[kMaxKnapsackBins];  // after find_rows(), the bins of columns
    Ints row_mass[2], row_bin[2], column[kCols];
    Doubles cost[2][kCols];
    Doubles gain[kCols];  // cost from the first row minus cost from the second
    Ints before[kCols];   // mass of the columns served before each

    HORD_ALWAYS_INLINE explicit Knapsacks(const TransportBatchCosts& c) : costs(c) {}

    HORD_ALWAYS_INLINE void transpose(const KnapsackBatch& batch) {
        std::int32_t masses[kMaxKnapsackBins][kBatchLanes], bytes[2][kBatchLanes];
        for (int l = 0; l < kBatchLanes; ++l) {
            const SparseDifference& d = batch.difference[l];
            std::int32_t four[2];
            std::memcpy(four, d.bin, sizeof(four));
#pragma GCC unroll 5
            for (int k = 0; k < kMaxKnapsackBins; ++k) masses[k][l] = d.excess[k];
            bytes[0][l] = four[0];
            bytes[1][l] = four[1];
            denominator[l] = d.denominator;
        }
#pragma GCC unroll 5
        for (int k = 0; k < kMaxKnapsackBins; ++k) {
            excess[k] = Ints::load(masses[k]);
            bin[k] = (Ints::load(bytes[k / 4]) >> k % 4 * 8) & Ints::broadcast(0xFF);
        }
    }

    // Mask of the lanes whose rows are the deficit: it has fewer bins, or equally many and the first one
    // (Residual::rows()).
    HORD_ALWAYS_INLINE Ints deficit_is_rows() const {
        const Ints none = Ints::broadcast(0);
        Ints surplus_bins = none, first = none;
#pragma GCC unroll 5
        for (int k = kMaxKnapsackBins - 1; k >= 0; --k) {
            const Ints is_surplus = excess[k].greater_than(none), is_deficit = none.greater_than(excess[k]);
            surplus_bins = surplus_bins - is_surplus + is_deficit;
            first = select(is_surplus | is_deficit, excess[k], first);
        }
        return surplus_bins.greater_than(none) | (surplus_bins.equal_to(none) & none.greater_than(first));
    }

    // Moves the rows out of the bins; the bins behind a row move up.
    HORD_ALWAYS_INLINE void find_rows() {
        const Ints none = Ints::broadcast(0), turned = deficit_is_rows();
        row_mass[0] = row_mass[1] = row_bin[0] = row_bin[1] = none;
#pragma GCC unroll 5
        for (int k = kMaxKnapsackBins - 1; k >= 0; --k) {
            excess[k] = (excess[k] ^ turned) - turned;
            const Ints is_row = excess[k].greater_than(none);
            row_mass[1] = select(is_row, row_mass[0], row_mass[1]);
            row_bin[1] = select(is_row, row_bin[0], row_bin[1]);
            row_mass[0] = select(is_row, excess[k], row_mass[0]);
            row_bin[0] = select(is_row, bin[k], row_bin[0]);
#pragma GCC unroll 5
            for (int j = k; j + 1 < kMaxKnapsackBins; ++j) {
                excess[j] = select(is_row, excess[j + 1], excess[j]);
                bin[j] = select(is_row, bin[j + 1], bin[j]);
            }
            excess[kCols] = select(is_row, none, excess[kCols]);
        }
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) column[j] = none - excess[j];
    }

    HORD_ALWAYS_INLINE void look_up_costs() {
        const Ints begin[2] = {row_bin[0] * Ints::broadcast(costs.bins), row_bin[1] * Ints::broadcast(costs.bins)};
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            for (int row = 0; row < 2; ++row) {
                std::uint32_t place[kBatchLanes];
                double c[kBatchLanes];
                (begin[row] + bin[j]).template bit_cast<std::uint32_t>().store(place);
                for (int l = 0; l < kBatchLanes; ++l) c[l] = costs.table[place[l]];
                cost[row][j] = Doubles::load(c);
            }
            gain[j] = cost[0][j] - cost[1][j];
        }
    }

    HORD_ALWAYS_INLINE void order_columns() {
        Floats key[kCols];
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            double exact[kBatchLanes];
            float rough[kBatchLanes];
            gain[j].store(exact);
            for (int l = 0; l < kBatchLanes; ++l) rough[l] = static_cast<float>(exact[l]);
            key[j] = ((Floats::load(rough).template bit_cast<std::int32_t>() & Ints::broadcast(~kColumnBits)) |
                      Ints::broadcast(j))
                         .template bit_cast<float>();
            before[j] = Ints::broadcast(0);
        }
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
#pragma GCC unroll 4
            for (int k = 0; k < j; ++k) {
                const Ints j_first = key[j].less_than(key[k]);
                before[k] = before[k] + (j_first & column[j]);
                before[j] = before[j] + select(j_first, Ints::broadcast(0), column[k]);
            }
        }
    }

    HORD_ALWAYS_INLINE void answer(KnapsackAnswer& to) const {
        constexpr double kInfinity = std::numeric_limits<double>::infinity();
        double sum[kBatchLanes] = {}, most_served[kBatchLanes], least_left[kBatchLanes];  // gains
        for (int l = 0; l < kBatchLanes; ++l) most_served[l] = -kInfinity;
        for (int l = 0; l < kBatchLanes; ++l) least_left[l] = kInfinity;
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            std::int32_t taken[kBatchLanes], left[kBatchLanes];
            double by[kBatchLanes], first[kBatchLanes], second[kBatchLanes];
            const Ints by_first = min(max(row_mass[0] - before[j], Ints::broadcast(0)), column[j]);
            by_first.store(taken);
            (column[j] - by_first).store(left);
            gain[j].store(by);
            cost[0][j].store(first);
            cost[1][j].store(second);
            for (int l = 0; l < kBatchLanes; ++l) {
                const auto of_first = static_cast<double>(taken[l]), of_second = static_cast<double>(left[l]);
                const double served = of_first > 0 ? by[l] : -kInfinity, not_served = of_second > 0 ? by[l] : kInfinity;
                most_served[l] = most_served[l] < served ? served : most_served[l];
                least_left[l] = not_served < least_left[l] ? not_served : least_left[l];
                sum[l] += of_first * first[l] + of_second * second[l];
            }
        }
        for (int l = 0; l < kBatchLanes; ++l) to.distance[l] = sum[l] / static_cast<double>(denominator[l]);
        to.proven = 0;
        for (int l = 0; l < kBatchLanes; ++l)
            to.proven |= (most_served[l] - least_left[l] <= costs.tolerance ? 1U : 0U) << l;
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE void solve(const KnapsackBatch& batch, const TransportBatchCosts& costs, KnapsackAnswer& answer) {
    Knapsacks<Bytes> knapsacks(costs);
    knapsacks.transpose(batch);
    knapsacks.find_rows();
    knapsacks.look_up_costs();
    knapsacks.order_columns();
    knapsacks.answer(answer);
}

HORD_FOR_EACH_ISA(solve_for, solve)

}  // namespace

SolveKnapsackBatch knapsack_kernel(Isa isa) { return solve_for(isa); }

}  // namespace hord::algo
