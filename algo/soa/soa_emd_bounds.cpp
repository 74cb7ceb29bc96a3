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
using Lanes = float[kLanes];  // of one bin, column or line, in memory

// What a step right and a step down cost more than the diagonal: 2 - sqrt(2), rounded down.
constexpr float kDiagonalSaves = 0x1.2bec32p-1F;

// Bin pitches: what moving the faint light of one side of the box inwards may add to a bound.
constexpr float kFaintBins = 0x1p-6F;

// The bins of a box, seen along one axis: a line is `steps` bins, `step` places apart; the lines are `line` apart.
struct Along {
    int steps, lines, step, line;
};

// The cost of the plan that moves light within the lines as far as each line needs, and between lines in the columns,
// shared out as both HORDs' light is over the columns (docs/notes/emd.md). `differences` of the box; of each column its
// share of the light; of each line its surplus.
template <int Bytes>
HORD_ALWAYS_INLINE Floats<Bytes> plan_cost(const Lanes* differences, const Along& along, const Lanes* share,
                                           const Lanes* surplus, int lane) {
    using F = Floats<Bytes>;
    const F zero = F::broadcast(0);
    alignas(kAlignment) float shares_up_to[kMaxBins][Bytes / sizeof(float)];
    F up_to_column = zero;
    for (int i = 0; i < along.steps; ++i) {
        up_to_column = up_to_column + F::load(share[i] + lane);
        up_to_column.store(shares_up_to[i]);
    }
    F between = zero, cost = zero, came_down = zero, came_up = zero;  // came: over the edge above line j
    F turns_out = zero, turns_in = zero;
    for (int j = 0; j < along.lines; ++j) {
        const Lanes* const line = differences + j * along.line;
        const F of_line = F::load(surplus[j] + lane);
        between = j + 1 < along.lines ? between + of_line : zero;  // from line j to line j + 1
        const F down = max(between, zero), up = down - between;
        const F leaves = down + came_up, comes = came_down + up;  // light that leaves line j for another, and comes
        cost = cost + (down + up);
        came_down = down;
        came_up = up;
        F up_to = zero, right_before = zero, left_before = zero;
        for (int i = 0; i + 1 < along.steps; ++i) {
            up_to = up_to + F::load(line[i * along.step] + lane);
            const F flow = up_to - F::load(shares_up_to[i]) * of_line;
            const F right = max(flow, zero), left = right - flow;  // from column i to column i + 1, and back
            cost = cost + (right + left);
            const F of_column = F::load(share[i] + lane);
            turns_out = turns_out + min(right_before + left, of_column * leaves);
            turns_in = turns_in + min(left_before + right, of_column * comes);
            right_before = right;
            left_before = left;
        }
        const F last = F::load(share[along.steps - 1] + lane);
        turns_out = turns_out + min(right_before, last * leaves);
        turns_in = turns_in + min(left_before, last * comes);
    }
    return cost - max(turns_out, turns_in) * F::broadcast(kDiagonalSaves);
}

// The sums of sixteen pairs over the columns, or over the lines, of a box.
struct Margins {
    alignas(kAlignment) Lanes share[kMaxBins], surplus[kMaxBins], moves[kMaxBins];  // moves: sum of |differences|

    void add(int from, int to) {
        for (int l = 0; l < kLanes; ++l) {
            share[to][l] += share[from][l];
            surplus[to][l] += surplus[from][l];
        }
    }
};

// How many columns, from `first` on in direction `step`, hold so little light that moving it to the next one inwards
// costs at most kFaintBins in each pair. Adds this cost to `cost`.
int faint(const Margins& margins, int first, int step, int columns, float* cost) {
    float moved[kLanes] = {}, cost_so_far[kLanes] = {};
    int count = 0;
    for (; count + 1 < columns; ++count) {
        const float* const here = margins.moves[first + count * step];
        int too_much = 0;
        float next[kLanes];
        for (int l = 0; l < kLanes; ++l) {
            moved[l] += here[l];
            next[l] = cost_so_far[l] + moved[l];
            too_much |= next[l] > kFaintBins ? 1 : 0;
        }
        if (too_much != 0) break;
        std::copy_n(next, kLanes, cost_so_far);
    }
    for (int l = 0; l < kLanes; ++l) cost[l] += cost_so_far[l];
    return count;
}

template <int Bytes>
HORD_ALWAYS_INLINE void bound(const float* a, const float* b, std::size_t stride, int bins_i, const LitBox& box,
                              float* upper) {
    using F = Floats<Bytes>;
    constexpr int kGroup = Bytes / static_cast<int>(sizeof(float));
    const int columns = box.last_i - box.first_i + 1, lines = box.last_j - box.first_j + 1;
    if (columns <= 0 || lines <= 0) {
        std::fill_n(upper, kLanes, 0.0F);
        return;
    }
    const std::size_t of_line = stride * static_cast<std::size_t>(bins_i),
                      first = static_cast<std::size_t>(box.first_i) * stride +
        static_cast<std::size_t>(box.first_j) * of_line;
    alignas(kAlignment) Lanes differences[kMaxBinCount];
    Margins of_columns, of_lines;
    const F zero = F::broadcast(0), half = F::broadcast(0.5F);
    for (int lane = 0; lane < kLanes; lane += kGroup) {
        for (int i = 0; i < columns; ++i) {
            zero.store(of_columns.share[i] + lane);
            zero.store(of_columns.surplus[i] + lane);
            zero.store(of_columns.moves[i] + lane);
        }
        for (int j = 0; j < lines; ++j) {
            F all = zero, surplus = zero, moves = zero;
            std::size_t at = first + static_cast<std::size_t>(lane) + static_cast<std::size_t>(j) * of_line;
            for (int i = 0; i < columns; ++i, at += stride) {
                const F of_a = F::load(a + at), of_b = F::load(b + at), both = of_a + of_b, difference = of_a - of_b,
                        size = max(difference, zero - difference);
                difference.store(differences[j * columns + i] + lane);
                (F::load(of_columns.share[i] + lane) + both).store(of_columns.share[i] + lane);
                (F::load(of_columns.surplus[i] + lane) + difference).store(of_columns.surplus[i] + lane);
                (F::load(of_columns.moves[i] + lane) + size).store(of_columns.moves[i] + lane);
                all = all + both;
                surplus = surplus + difference;
                moves = moves + size;
            }
            (all * half).store(of_lines.share[j] + lane);
            surplus.store(of_lines.surplus[j] + lane);
            moves.store(of_lines.moves[j] + lane);
        }
        for (int i = 0; i < columns; ++i)
            (F::load(of_columns.share[i] + lane) * half).store(of_columns.share[i] + lane);
    }
    // Faint light at the box's borders moves inwards first: noise in single bins would make every box a large one.
    alignas(kAlignment) float cost[kLanes] = {};
    const int left = faint(of_columns, 0, 1, columns, cost),
              right = faint(of_columns, columns - 1, -1, columns - left, cost),
              above = faint(of_lines, 0, 1, lines, cost), below = faint(of_lines, lines - 1, -1, lines - above, cost);
    const auto add = [&](int from, int to) {
        for (int l = 0; l < kLanes; ++l) differences[to][l] += differences[from][l];
    };
    for (int k = 0; k < left + right; ++k) {
        const int from = k < left ? k : columns - 1 - (k - left), to = k < left ? left : columns - 1 - right;
        of_columns.add(from, to);
        for (int j = 0; j < lines; ++j) add(j * columns + from, j * columns + to);
    }
    const int steps = columns - left - right;
    for (int k = 0; k < above + below; ++k) {
        const int from = k < above ? k : lines - 1 - (k - above), to = k < above ? above : lines - 1 - below;
        of_lines.add(from, to);
        for (int i = left; i < left + steps; ++i) add(from * columns + i, to * columns + i);
    }
    const Lanes* const core = differences + above * columns + left;
    const int rows = lines - above - below;
    for (int lane = 0; lane < kLanes; lane += kGroup) {
        const F by_lines = plan_cost<Bytes>(core, {steps, rows, 1, columns}, of_columns.share + left,
                                            of_lines.surplus + above, lane),
                by_columns = plan_cost<Bytes>(core, {rows, steps, columns, 1}, of_lines.share + above,
                                              of_columns.surplus + left, lane);
        const F least = min(by_lines, by_columns) + F::load(cost + lane);
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

void SoaEmdBounds::row(const SoaDistances& rows, int n, const std::uint8_t* mask, std::uint8_t left_out, float* upper,
                       int most_bins) const {
    if (n == 0 || n == extents_.n - 1) {
        std::fill_n(upper, extents_.m, 0.0F);
        return;
    }
    const SoaRow &above = rows.loaded(n + 2), &here = rows.loaded(n), &below = rows.loaded(n + 1);
    for (int block = 0; block < here.blocks(); ++block) {
        const int first = block * kLanes, count = std::min(kLanes, extents_.m - first);
        if (std::all_of(mask + first, mask + first + count,
                        [&](std::uint8_t bits) { return (bits & left_out) != 0; })) {
            std::fill_n(upper + first, count, 0.0F);
            continue;
        }
        SoaRow::Lit lit = here.lit(block);
        if (block > 0) unite(lit, here.lit(block - 1));
        if (block + 1 < here.blocks()) unite(lit, here.lit(block + 1));
        alignas(kAlignment) float across[kLanes], down[kLanes];
        const LitBox box = box_of(lit);
        lit = above.lit(block);
        unite(lit, below.lit(block));
        const LitBox box_down = box_of(lit);
        if (std::max(box.bins(), box_down.bins()) > most_bins) {
            // A difference to one neighbour alone counts twice.
            const float most =
                2 * std::hypot(box.diagonal(), box_down.diagonal()) * (1 + kRelativeMargin) + kMarginBins;
            for (int m = first; m < first + count; ++m) upper[m] = (mask[m] & left_out) != 0 ? 0 : most;
            continue;
        }
        bound_(here.array(0) + first - 1, here.array(0) + first + 1, here.stride(), extents_.i, box, across);
        bound_(above.array(0) + first, below.array(0) + first, here.stride(), extents_.i, box_down, down);
        const bool whole = rows.all_neighbours_have_hords(n, block);
        for (int l = 0; l < count; ++l) {
            const int m = first + l;
            float x = across[l], y = down[l];
            if ((mask[m] & left_out) != 0) {
                upper[m] = 0;
                continue;
            }
            if (!whole) {
                const Stencil s = stencil(here.has_hord(m - 1), here.has_hord(m + 1)),
                              t = stencil(above.has_hord(m), below.has_hord(m));
                if (s.weight() != 1) x = 2 * alone(here, m + s.before, here, m + s.after);
                if (t.weight() != 1) y = 2 * alone(rows.loaded(n + t.before), m, rows.loaded(n + t.after), m);
            }
            const float norm = std::sqrt(x * x + y * y);
            upper[m] = norm + norm * 0x1p-22F;
        }
    }
}

}  // namespace hord::algo
