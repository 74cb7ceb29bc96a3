#include "algo/emd/knapsack_batch.h"

#include <cstring>
#include <limits>

#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

constexpr int kCols = kMaxKnapsackBins - 1;  // without a row there is nothing to move
// Of a key, as many as in transport_batch.cpp, and columns in the same order: so that columns of as much gain are
// served in the same order, too, to the same bits.
constexpr std::int32_t kColumnBits = 0xFF;

// Always inlined, so that it is compiled for the instruction set of its caller.
template <int Bytes>
struct Few {
    using Floats = Vec<float, kWide, Bytes>;
    using Ints = Vec<std::int32_t, kWide, Bytes>;
    using Doubles = Vec<double, kWide, Bytes>;

    const TransportBatchCosts& costs;
    std::int32_t denominator[kWide];
    Ints more[kMaxKnapsackBins], bin[kMaxKnapsackBins];  // after find_rows(), the bins of columns
    Ints row_mass[2], row_bin[2], column[kCols];
    Doubles cost[2][kCols];
    Doubles gain[kCols];  // by the first row instead of the second
    Ints before[kCols];   // what the columns before one want

    HORD_ALWAYS_INLINE explicit Few(const TransportBatchCosts& c) : costs(c) {}

    HORD_ALWAYS_INLINE void transpose(const KnapsackBatch& batch) {
        std::int32_t masses[kMaxKnapsackBins][kWide], bytes[2][kWide];
        for (int l = 0; l < kWide; ++l) {
            const ClosedDifference& d = batch.difference[l];
            std::int32_t four[2];
            std::memcpy(four, d.bin, sizeof(four));
#pragma GCC unroll 5
            for (int k = 0; k < kMaxKnapsackBins; ++k) masses[k][l] = d.more[k];
            bytes[0][l] = four[0];
            bytes[1][l] = four[1];
            denominator[l] = d.denominator;
        }
#pragma GCC unroll 5
        for (int k = 0; k < kMaxKnapsackBins; ++k) {
            more[k] = Ints::load(masses[k]);
            bin[k] = (Ints::load(bytes[k / 4]) >> k % 4 * 8) & Ints::broadcast(0xFF);
        }
    }

    // All bits where rows are what has too little, as Residual::rows() says: where that has fewer bins; of equals the
    // one that comes first.
    HORD_ALWAYS_INLINE Ints less_are_rows() const {
        const Ints none = Ints::broadcast(0);
        Ints bins_more = none, first = none;
#pragma GCC unroll 5
        for (int k = kMaxKnapsackBins - 1; k >= 0; --k) {
            const Ints is_more = more[k].greater_than(none), is_less = none.greater_than(more[k]);
            bins_more = bins_more - is_more + is_less;
            first = select(is_more | is_less, more[k], first);
        }
        return bins_more.greater_than(none) | (bins_more.equal_to(none) & none.greater_than(first));
    }

    // Takes the rows out; what is behind one moves up.
    HORD_ALWAYS_INLINE void find_rows() {
        const Ints none = Ints::broadcast(0), turned = less_are_rows();
        row_mass[0] = row_mass[1] = row_bin[0] = row_bin[1] = none;
#pragma GCC unroll 5
        for (int k = kMaxKnapsackBins - 1; k >= 0; --k) {
            more[k] = (more[k] ^ turned) - turned;
            const Ints is_row = more[k].greater_than(none);
            row_mass[1] = select(is_row, row_mass[0], row_mass[1]);
            row_bin[1] = select(is_row, row_bin[0], row_bin[1]);
            row_mass[0] = select(is_row, more[k], row_mass[0]);
            row_bin[0] = select(is_row, bin[k], row_bin[0]);
#pragma GCC unroll 5
            for (int j = k; j + 1 < kMaxKnapsackBins; ++j) {
                more[j] = select(is_row, more[j + 1], more[j]);
                bin[j] = select(is_row, bin[j + 1], bin[j]);
            }
            more[kCols] = select(is_row, none, more[kCols]);
        }
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) column[j] = none - more[j];
    }

    HORD_ALWAYS_INLINE void look_up_costs() {
        const Ints begin[2] = {row_bin[0] * Ints::broadcast(costs.bins), row_bin[1] * Ints::broadcast(costs.bins)};
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            for (int row = 0; row < 2; ++row) {
                std::uint32_t place[kWide];
                double c[kWide];
                (begin[row] + bin[j]).template bit_cast<std::uint32_t>().store(place);
                for (int l = 0; l < kWide; ++l) c[l] = costs.table[place[l]];
                cost[row][j] = Doubles::load(c);
            }
            gain[j] = cost[0][j] - cost[1][j];
        }
    }

    HORD_ALWAYS_INLINE void order_columns() {
        Floats key[kCols];
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            double exact[kWide];
            float rough[kWide];
            gain[j].store(exact);
            for (int l = 0; l < kWide; ++l) rough[l] = static_cast<float>(exact[l]);
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
        double sum[kWide] = {}, most_served[kWide], least_left[kWide];  // gains
        for (int l = 0; l < kWide; ++l) most_served[l] = -kInfinity;
        for (int l = 0; l < kWide; ++l) least_left[l] = kInfinity;
#pragma GCC unroll 4
        for (int j = 0; j < kCols; ++j) {
            std::int32_t taken[kWide], left[kWide];
            double by[kWide], first[kWide], second[kWide];
            const Ints by_first = min(max(row_mass[0] - before[j], Ints::broadcast(0)), column[j]);
            by_first.store(taken);
            (column[j] - by_first).store(left);
            gain[j].store(by);
            cost[0][j].store(first);
            cost[1][j].store(second);
            for (int l = 0; l < kWide; ++l) {
                const auto of_first = static_cast<double>(taken[l]), of_second = static_cast<double>(left[l]);
                const double served = of_first > 0 ? by[l] : -kInfinity, not_served = of_second > 0 ? by[l] : kInfinity;
                most_served[l] = most_served[l] < served ? served : most_served[l];
                least_left[l] = not_served < least_left[l] ? not_served : least_left[l];
                sum[l] += of_first * first[l] + of_second * second[l];
            }
        }
        for (int l = 0; l < kWide; ++l) to.distance[l] = sum[l] / static_cast<double>(denominator[l]);
        to.proven = 0;
        for (int l = 0; l < kWide; ++l) to.proven |= (most_served[l] - least_left[l] <= costs.tolerance ? 1U : 0U) << l;
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE void solve(const KnapsackBatch& batch, const TransportBatchCosts& costs, KnapsackAnswer& answer) {
    Few<Bytes> few(costs);
    few.transpose(batch);
    few.find_rows();
    few.look_up_costs();
    few.order_columns();
    few.answer(answer);
}

HORD_FOR_EACH_ISA(few_for, void, solve,
                  (const KnapsackBatch& batch, const TransportBatchCosts& costs, KnapsackAnswer& answer),
                  (batch, costs, answer))

}  // namespace

SolveFew knapsack_kernel(Isa isa) { return few_for(isa); }

}  // namespace hord::algo
