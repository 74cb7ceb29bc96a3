#include "algo/soa/soa_emd_bounds.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "algo/features/stencil.h"
#include "algo/simd/vec.h"

namespace hord::algo {
namespace {

constexpr int kLanes = SoaRow::kLanes;

// As many lenslets as fit a machine vector, so that the sums of a plan stay in registers.
template <int Bytes>
using Floats = Vec<float, Bytes / static_cast<int>(sizeof(float)), Bytes>;
template <int Bytes>
using Values = float[Bytes / sizeof(float)];  // in memory

// What a step right and a step down cost more than the diagonal: 2 - sqrt(2), rounded down.
constexpr float kDiagonalSaves = 0x1.2bec32p-1F;

// The bins of a box, seen along one axis: a line is `steps` bins, `step` places apart; the lines are `line` apart.
struct Along {
    int steps, lines, step, line;
};

// The cost of the plan that moves light within the lines as far as each line needs, and between lines in the columns,
// shared out as both HORDs' light is over the columns (docs/notes/emd.md). `differences` of the box; of each column its
// share of the light; of each line its surplus.
template <int Bytes>
HORD_ALWAYS_INLINE Floats<Bytes> plan_cost(const Values<Bytes>* differences, const Along& along,
                                           const Values<Bytes>* share, const Values<Bytes>* surplus) {
    using F = Floats<Bytes>;
    const F zero = F::broadcast(0);
    alignas(kAlignment) Values<Bytes> shares_up_to[kMaxBins];
    F up_to_column = zero;
    for (int i = 0; i < along.steps; ++i) {
        up_to_column = up_to_column + F::load(share[i]);
        up_to_column.store(shares_up_to[i]);
    }
    F between = zero, cost = zero, came_down = zero, came_up = zero;  // came: over the edge above line j
    F turns_out = zero, turns_in = zero;
    for (int j = 0; j < along.lines; ++j) {
        const Values<Bytes>* const line = differences + j * along.line;
        const F of_line = F::load(surplus[j]);
        between = j + 1 < along.lines ? between + of_line : zero;  // from line j to line j + 1
        const F down = max(between, zero), up = down - between;
        const F leaves = down + came_up, comes = came_down + up;  // light that leaves line j for another, and comes
        cost = cost + (down + up);
        came_down = down;
        came_up = up;
        F up_to = zero, right_before = zero, left_before = zero;
        for (int i = 0; i + 1 < along.steps; ++i) {
            up_to = up_to + F::load(line[i * along.step]);
            const F flow = up_to - F::load(shares_up_to[i]) * of_line;
            const F right = max(flow, zero), left = right - flow;  // from column i to column i + 1, and back
            cost = cost + (right + left);
            turns_out = turns_out + min(right_before + left, F::load(share[i]) * leaves);
            turns_in = turns_in + min(left_before + right, F::load(share[i]) * comes);
            right_before = right;
            left_before = left;
        }
        const F last = F::load(share[along.steps - 1]);
        turns_out = turns_out + min(right_before, last * leaves);
        turns_in = turns_in + min(left_before, last * comes);
    }
    return cost - max(turns_out, turns_in) * F::broadcast(kDiagonalSaves);
}

template <int Bytes>
HORD_ALWAYS_INLINE void bound(const float* a, const float* b, std::size_t stride, int bins_i, const LitBox& box,
                              float* upper) {
    using F = Floats<Bytes>;
    const int columns = box.last_i - box.first_i + 1, lines = box.last_j - box.first_j + 1;
    if (columns <= 0) {
        std::fill_n(upper, kLanes, 0.0F);
        return;
    }
    const std::size_t of_line = stride * static_cast<std::size_t>(bins_i),
                      first = static_cast<std::size_t>(box.first_i) * stride +
        static_cast<std::size_t>(box.first_j) * of_line;
    for (std::size_t lane = 0; lane < kLanes; lane += Bytes / sizeof(float)) {
        alignas(kAlignment) Values<Bytes> differences[kMaxBinCount], column_share[kMaxBins], column_surplus[kMaxBins],
            line_share[kMaxBins], line_surplus[kMaxBins];
        const F zero = F::broadcast(0), half = F::broadcast(0.5F);
        for (int i = 0; i < columns; ++i) {
            zero.store(column_share[i]);
            zero.store(column_surplus[i]);
        }
        Values<Bytes>* to = differences;
        for (int j = 0; j < lines; ++j) {
            F all = zero, surplus = zero;
            std::size_t at = first + lane + static_cast<std::size_t>(j) * of_line;
            for (int i = 0; i < columns; ++i, at += stride) {
                const F of_a = F::load(a + at), of_b = F::load(b + at), both = of_a + of_b, difference = of_a - of_b;
                difference.store(*to++);
                (F::load(column_share[i]) + both).store(column_share[i]);
                (F::load(column_surplus[i]) + difference).store(column_surplus[i]);
                all = all + both;
                surplus = surplus + difference;
            }
            (all * half).store(line_share[j]);
            surplus.store(line_surplus[j]);
        }
        for (int i = 0; i < columns; ++i) (F::load(column_share[i]) * half).store(column_share[i]);
        const F by_lines = plan_cost<Bytes>(differences, {columns, lines, 1, columns}, column_share, line_surplus),
                by_columns = plan_cost<Bytes>(differences, {lines, columns, columns, 1}, line_share, column_surplus);
        const F least = min(by_lines, by_columns);
        (least + least * F::broadcast(SoaEmdBounds::kRelativeMargin) + F::broadcast(SoaEmdBounds::kMarginBins))
            .store(upper + lane);
    }
}

HORD_FOR_EACH_ISA(bound_for, bound)

}  // namespace

SoaEmdBounds::SoaEmdBounds(const Extents& extents, Isa isa) : extents_(extents), bound_(bound_for(isa)) {}

LitBox SoaEmdBounds::box_of(const SoaRow::Lit& lit) const {
    std::uint32_t columns = 0, lines = 0;
    const std::uint32_t line_of_bins = (1U << extents_.i) - 1;
    for (int j = 0, bin = 0; j < extents_.j; ++j, bin += extents_.i) {
        const auto word = static_cast<std::size_t>(bin / 64);
        std::uint64_t bits = lit[word] >> (bin % 64);
        if (bin % 64 + extents_.i > 64) bits |= lit[word + 1] << (64 - bin % 64);
        const std::uint32_t of_line = static_cast<std::uint32_t>(bits) & line_of_bins;
        columns |= of_line;
        lines |= std::uint32_t{of_line != 0} << j;
    }
    if (lines == 0) return {};
    const auto last_of = [](std::uint32_t set) { return static_cast<int>(std::bit_width(set)) - 1; };
    return {std::countr_zero(columns), last_of(columns), std::countr_zero(lines), last_of(lines)};
}

// Of two single lenslets: those in the first lane.
float SoaEmdBounds::alone(const SoaRow& a, int m_a, const SoaRow& b, int m_b) const {
    SoaRow::Lit lit = a.lit(m_a / kLanes);
    unite(lit, b.lit(m_b / kLanes));
    const LitBox box = box_of(lit);
    float upper[kLanes];
    bound_(a.array(0) + m_a, b.array(0) + m_b, a.stride(), extents_.i, box, upper);
    return upper[0];
}

void SoaEmdBounds::row(const SoaDistances& rows, int n, const std::uint8_t* mask, float* upper) const {
    if (n == 0 || n == extents_.n - 1) {
        std::fill_n(upper, extents_.m, 0.0F);
        return;
    }
    const SoaRow &above = rows.loaded(n + 2), &here = rows.loaded(n), &below = rows.loaded(n + 1);
    for (int block = 0; block < here.blocks(); ++block) {
        const int first = block * kLanes, count = std::min(kLanes, extents_.m - first);
        SoaRow::Lit lit = here.lit(block);
        if (block > 0) unite(lit, here.lit(block - 1));
        if (block + 1 < here.blocks()) unite(lit, here.lit(block + 1));
        alignas(kAlignment) float across[kLanes], down[kLanes];
        bound_(here.array(0) + first - 1, here.array(0) + first + 1, here.stride(), extents_.i, box_of(lit), across);
        lit = above.lit(block);
        unite(lit, below.lit(block));
        bound_(above.array(0) + first, below.array(0) + first, here.stride(), extents_.i, box_of(lit), down);
        const bool whole = rows.all_neighbours_have_hords(n, block);
        for (int l = 0; l < count; ++l) {
            const int m = first + l;
            float x = across[l], y = down[l];
            if (!whole) {
                if ((mask[m] & kNoGradient) != 0) {
                    upper[m] = 0;
                    continue;
                }
                const Stencil s = stencil(here.has_hord(m - 1), here.has_hord(m + 1)),
                              t = stencil(above.has_hord(m), below.has_hord(m));
                if (s.weight() != 1) x = 2 * alone(here, m + s.before, here, m + s.after);
                if (t.weight() != 1) y = 2 * alone(rows.loaded(n + t.before), m, rows.loaded(n + t.after), m);
            }
            const float norm = std::sqrt(x * x + y * y);
            upper[m] = norm + norm * 0x1p-22F;
        }
    }
    upper[0] = upper[extents_.m - 1] = 0;
}

}  // namespace hord::algo
