#include "algo/transport_start.h"

#include "algo/transport_lanes.h"

namespace hord::algo {
namespace {

constexpr int kWide = kMostStarts;
constexpr int kNodes = 2 * kMostStartSide;
constexpr std::int32_t kClosed = 1 << 29;  // is added to keys, -2^28 to 2^27, of a row or column that is used up: above all open ones, and twice below 2^31
constexpr int kPartialSums = 8;            // in which the simplex adds up a row

// Always inlined, so that it is compiled for the instruction set of its caller.
template <int Bytes>
struct Starts {
    using Ints = Lanes<std::int32_t, kWide, Bytes>;
    using Floats = Lanes<float, kWide, Bytes>;

    const TransportBatch& b;
    TransportStarts& starts;
    const int rows;
    const int cols;
    const TransportTag tag;
    // Nodes are rows, then columns.
    double left[kNodes][kWide];
    float share[kNodes][kWide];
    std::int32_t closed[kNodes][kWide];
    std::int32_t key[kMostStartSide * kMostStartSide][kWide];  // of cells, row by row

    HORD_ALWAYS_INLINE Starts(const TransportBatch& batch, TransportStarts& out) : b(batch), starts(out), rows(batch.rows), cols(batch.cols), tag(rows, cols) {}

    HORD_ALWAYS_INLINE void gather_costs(const TransportCosts& costs) {
        for (int l = 0; l < kWide; ++l) {
            const TransportBatch::Problem& p = b.problem[static_cast<std::size_t>(l < b.filled ? l : 0)];
            const std::uint8_t* const col_bin = p.cols.bin.data();
            for (int i = 0; i < rows; ++i) {
                const std::int32_t* const from = costs.table + std::ptrdiff_t{p.rows.bin[static_cast<std::size_t>(i)]} * costs.stride;
                std::int32_t* to = &key[i * cols][l];
                for (int j = 0; j < cols; ++j) to[j * kWide] = from[col_bin[j]];
            }
        }
        const Ints half = Ints::all(tag.all / 2 + 1), no_tag = Ints::all(~tag.all);
        for (int i = 0; i < rows; ++i) {
            for (int j = 0; j < cols; ++j) {
                std::int32_t* const here = key[i * cols + j];
                (((Ints::at(here) + half) & no_tag) + Ints::all(i << tag.col_bits | j)).to(here);
            }
        }
    }

    HORD_ALWAYS_INLINE void take_masses() {
        for (int l = 0; l < kWide; ++l) {
            const TransportBatch::Problem& p = b.problem[static_cast<std::size_t>(l < b.filled ? l : 0)];
            double total = 0;
            for (int i = 0; i < rows; ++i) total += p.rows.mass[static_cast<std::size_t>(i)];
            const double one = 1 / total;
            const auto take = [&](int node, double mass) __attribute__((always_inline)) {
                left[node][l] = mass;
                share[node][l] = static_cast<float>(mass * one);
            };
            for (int i = 0; i < rows; ++i) take(i, p.rows.mass[static_cast<std::size_t>(i)]);
            for (int j = 0; j < cols; ++j) take(rows + j, p.cols.mass[static_cast<std::size_t>(j)]);
        }
    }

    // From each cell its row's and its column's mass-weighted mean cost is taken.
    HORD_ALWAYS_INLINE void order_cells() {
        float mean_col[kMostStartSide][kWide];
        std::int32_t rough_mean_row[kMostStartSide][kWide];
        const Ints no_tag = Ints::all(~tag.all);
        for (int j = 0; j < cols; ++j) Floats::all(0).to(mean_col[j]);
        for (int i = 0; i < rows; ++i) {
            const Floats weight = Floats::at(share[i]);
            Floats sum[kPartialSums];
            for (int first = 0; first < kPartialSums; ++first) {
                sum[first] = Floats::all(0);
                for (int j = first; j < cols; j += kPartialSums) {
                    const Floats c = Ints::at(key[i * cols + j]).template converted<float>();
                    sum[first] = sum[first] + c * Floats::at(share[rows + j]);
                    (Floats::at(mean_col[j]) + c * weight).to(mean_col[j]);
                }
            }
            const Floats mean = ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]));
            (mean.template converted<std::int32_t>() & no_tag).to(rough_mean_row[i]);
        }
        std::int32_t rough_mean_col[kMostStartSide][kWide];
        for (int j = 0; j < cols; ++j) (Floats::at(mean_col[j]).template converted<std::int32_t>() & no_tag).to(rough_mean_col[j]);
        for (int i = 0; i < rows; ++i) {
            const Ints mean_row = Ints::at(rough_mean_row[i]);
            for (int j = 0; j < cols; ++j) {
                std::int32_t* const here = key[i * cols + j];
                (Ints::at(here) - mean_row - Ints::at(rough_mean_col[j])).to(here);
            }
        }
    }

    // The least of the cells whose row and column are open, of every problem.
    template <int Rows>
    HORD_ALWAYS_INLINE Ints least_of_rows(int first, Ints least) const {
        Ints in_row[Rows];
        for (Ints& r : in_row) r = Ints::all(2 * kClosed - 1);
        for (int j = 0; j < cols; ++j) {
            const Ints closed_col = Ints::at(closed[rows + j]);
            for (int r = 0; r < Rows; ++r) in_row[r] = lower(in_row[r], Ints::at(key[(first + r) * cols + j]) + closed_col);
        }
        for (int r = 0; r < Rows; ++r) least = lower(least, in_row[r] + Ints::at(closed[first + r]));
        return least;
    }
    HORD_ALWAYS_INLINE Ints least_open() const {
        Ints least = Ints::all(2 * kClosed - 1);
        int i = 0;
        for (; i + 4 <= rows; i += 4) least = least_of_rows<4>(i, least);
        for (; i < rows; ++i) least = least_of_rows<1>(i, least);
        return least & Ints::all(tag.all);
    }

    HORD_ALWAYS_INLINE void serve() {
        for (int node = 0; node < rows + cols; ++node) Ints::all(0).to(closed[node]);
        std::int32_t open_cols[kWide], best[kWide];
        Ints::all(cols).to(open_cols);
        for (int step = 0; step < rows + cols - 1; ++step) {
            least_open().to(best);
            for (int l = 0; l < kWide; ++l) {
                const std::int32_t i = best[l] >> tag.col_bits, j = best[l] & ((1 << tag.col_bits) - 1);
                double &left_row = left[i][l], &left_col = left[rows + j][l];
                const double flow = lower(left_row, left_col);
                // No branches: they would be guesses.
                const std::int32_t row_used_up = (left_row < left_col ? 1 : 0) | (open_cols[l] == 1 ? 1 : 0);
                open_cols[l] -= 1 - row_used_up;
                const std::int32_t col = rows + j;
                closed[col ^ ((i ^ col) & -row_used_up)][l] = kClosed;
                left_row -= flow;
                left_col -= flow;
                starts[static_cast<std::size_t>(l)][static_cast<std::size_t>(step)] = {flow, static_cast<std::int16_t>(i), static_cast<std::int16_t>(j), row_used_up != 0};
            }
        }
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE void find_starts(const TransportCosts& costs, const TransportBatch& batch, TransportStarts& starts) {
    Starts<Bytes> s(batch, starts);
    s.gather_costs(costs);
    s.take_masses();
    s.order_cells();
    s.serve();
}

HORD_FOR_EACH_ISA(starts_for, void, find_starts, (const TransportCosts& costs, const TransportBatch& batch, TransportStarts& starts), (costs, batch, starts))

}  // namespace

FindStarts find_starts_for(Isa isa) { return starts_for(isa); }

}  // namespace hord::algo
