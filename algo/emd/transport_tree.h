// The spanning tree of the transportation simplex, and its pivot. For transport_simplex.cpp only.
//
// Nodes are the rows and columns of the transport problem; its arcs, one fewer, are numbered. For every node the tree
// stores its path to the root, a set of arcs as bits. It stays strongly feasible (Cunningham 1976): docs/notes/emd.md.
// Flows are integers < 2^53 held in doubles, exact. Duals are integers (transport_simplex.cpp).
#pragma once

#include <bit>
#include <cstdint>
#include <limits>

#include "algo/simd/vec.h"

namespace hord::algo {

struct TransportArc {
    std::int32_t row = 0;  // nodes
    std::int32_t column = 0;
};

// Branch-free: the branch would be unpredictable.
HORD_ALWAYS_INLINE double negated_if(double value, bool negate) {
    return std::bit_cast<double>(std::bit_cast<std::uint64_t>(value) ^ static_cast<std::uint64_t>(negate) << 63);
}

// A set of arcs: Words words of 32 bits, stored in pairs.
template <int Words>
struct ArcSet {
    std::uint64_t pair[(Words + 1) / 2];

    HORD_ALWAYS_INLINE bool has(int arc) const { return (pair[arc / 64] >> (arc % 64) & 1U) != 0; }
    HORD_ALWAYS_INLINE static std::uint64_t bit(int arc) { return std::uint64_t{1} << (arc % 64); }
    HORD_ALWAYS_INLINE std::int32_t word(int w) const { return static_cast<std::int32_t>(pair[w / 2] >> (w % 2 * 32)); }
    HORD_ALWAYS_INLINE int count() const {
        int arcs = 0;
        for (const std::uint64_t p : pair) arcs += std::popcount(p);
        return arcs;
    }
    // Calls do_it(arc) for each arc, in ascending order.
    template <class Do>
    HORD_ALWAYS_INLINE void for_each(Do do_it) const {
        for (int k = 0; k < (Words + 1) / 2; ++k) {
            for (std::uint64_t rest = pair[k]; rest != 0; rest &= rest - 1) do_it(k * 64 + std::countr_zero(rest));
        }
    }
    template <class Of>
    HORD_ALWAYS_INLINE static ArcSet from(Of of_pair) {
        ArcSet set;
        for (int k = 0; k < (Words + 1) / 2; ++k) set.pair[k] = of_pair(k);
        return set;
    }
};

// Words: of 32 arcs each.
template <int Words, int Bytes>
struct TransportTree {
    static constexpr int kLanes = 8;
    using Ints = Vec<std::int32_t, kLanes, Bytes>;
    using Set = ArcSet<Words>;

    int first_column;    // rows are nodes from 0, columns from here; both padded to whole vectors
    int nodes;           // padding included, which has no path
    std::int32_t* path;  // Words x nodes
    std::int32_t* dual;  // of nodes: the cost of a tree arc plus the duals of its ends is 0
    double* flow;        // of arcs
    TransportArc* arc;
    Set row_is_below;  // arcs whose child is the row; else the column

    // Starts a tree with the root alone. attach() gives all other nodes but padding their path.
    HORD_ALWAYS_INLINE void set_root(int root) {
        const auto clear = [&](int last) __attribute__((always_inline)) {
            for (int w = 0; w < Words; ++w) Ints::broadcast(0).store(path + w * nodes + last - kLanes);
            Ints::broadcast(0).store(dual + last - kLanes);
        };
        clear(first_column);
        clear(nodes);
        for (int w = 0; w < Words; ++w) path[w * nodes + root] = 0;
        dual[root] = 0;
        row_is_below = {};
    }

    HORD_ALWAYS_INLINE Set path_of(int node) const {
        return Set::from([&](int k) __attribute__((always_inline)) {
            const auto word = [&](int w) __attribute__((always_inline)) {
                return std::uint64_t{static_cast<std::uint32_t>(path[w * nodes + node])};
            };
            return 2 * k + 1 < Words ? word(2 * k) | word(min(2 * k + 1, Words - 1)) << 32 : word(2 * k);
        });
    }

    // Adds arc number `a` between `row` and `column`, one of which is in the tree; the other becomes its child. The
    // dual of the child is limited to +-`largest`.
    HORD_ALWAYS_INLINE void attach(int a, int row, int column, bool row_below, double mass, std::int32_t cost,
                                   std::int32_t largest) {
        const int swap = (row ^ column) & -static_cast<int>(row_below);
        const int child = column ^ swap, parent = row ^ swap;
        for (int w = 0; w < Words; ++w) {
            path[w * nodes + child] =
                path[w * nodes + parent] | static_cast<std::int32_t>(Words == 1 || a / 32 == w ? 1U << (a % 32) : 0U);
        }
        row_is_below.pair[a / 64] |= std::uint64_t{row_below} << (a % 64);
        // No overflow for Words == 1: of at most 30 arcs a path has 15 of either sign, a cost is at most 2^27 + half a
        // tag.
        dual[child] = Words == 1 ? -(cost + dual[parent]) : min(largest, -min(largest, cost + dual[parent]));
        flow[a] = mass;
        arc[a] = {row, column};
    }

    // The cycle closed by an arc between `row` and `column`: flow circulates apex -> ... -> row -> column -> ... ->
    // apex.
    struct Cycle {
        Set arcs, row_part, column_part;  // all; those from the row, from the column, to the apex
        Set decreasing;                   // arcs whose flow decreases
    };
    HORD_ALWAYS_INLINE Cycle cycle(int row, int column) const {
        const Set above_row = path_of(row), above_column = path_of(column);
        Cycle c;
        c.arcs =
            Set::from([&](int k) __attribute__((always_inline)) { return above_row.pair[k] ^ above_column.pair[k]; });
        c.row_part =
            Set::from([&](int k) __attribute__((always_inline)) { return above_row.pair[k] & c.arcs.pair[k]; });
        c.column_part =
            Set::from([&](int k) __attribute__((always_inline)) { return above_column.pair[k] & c.arcs.pair[k]; });
        c.decreasing = Set::from([&](int k) __attribute__((always_inline)) {
            return (c.row_part.pair[k] & row_is_below.pair[k]) | (c.column_part.pair[k] & ~row_is_below.pair[k]);
        });
        return c;
    }

    // The arc between `row` and `column` enters; `reduced` is its reduced cost. Returns the arc that leaves.
    HORD_ALWAYS_INLINE TransportArc pivot(int row, int column, std::int32_t reduced) {
        Cycle c = cycle(row, column);
        double least = std::numeric_limits<double>::infinity();
        int leaves = 0;
        bool tie = false;
        c.decreasing.for_each([&](int a) __attribute__((always_inline)) {
            const double f = flow[a];
            tie = tie | (f == least);
            leaves ^= (leaves ^ a) & -(f < least ? 1 : 0);  // branch-free
            least = min(least, f);
        });
        if (tie) [[unlikely]]
            leaves = last_blocking(*this, c, least);
        c.arcs.for_each([&](int a)
                            __attribute__((always_inline)) { flow[a] += negated_if(least, c.decreasing.has(a)); });
        const bool with_column = c.column_part.has(leaves);
        const TransportArc left = arc[leaves];
        // Arcs between the entering and the leaving one change direction.
        const Set top = path_of(row_is_below.has(leaves) ? left.row : left.column);
        const Set bottom = path_of(with_column ? column : row);
        for (int k = 0; k < (Words + 1) / 2; ++k) row_is_below.pair[k] ^= bottom.pair[k] ^ top.pair[k];
        const std::uint64_t bit = Set::bit(leaves);
        row_is_below.pair[leaves / 64] = (row_is_below.pair[leaves / 64] & ~bit) | (with_column ? 0 : bit);
        flow[leaves] = least;
        arc[leaves] = {row, column};
        c.arcs.pair[leaves / 64] &= ~bit;
        move(0, first_column, leaves, c.arcs, with_column ? reduced : -reduced);
        move(first_column, nodes, leaves, c.arcs, with_column ? -reduced : reduced);
        return left;
    }

  private:
    // Updates the nodes whose path has arc `a`: their path changes by `change`, their dual by `step`.
    HORD_ALWAYS_INLINE void move(int first, int last, int a, const Set& change, std::int32_t step) const {
        const Ints bit = Ints::broadcast(static_cast<std::int32_t>(1U << (a % 32)));
        const Ints steps = Ints::broadcast(step);
        Ints changes[Words];
        for (int w = 0; w < Words; ++w) changes[w] = Ints::broadcast(change.word(w));
        const std::int32_t* const plane = path + a / 32 * nodes;
        for (int x = first; x < last; x += kLanes) {
            const Ints on_arc = (Ints::load(plane + x) & bit).equal_to(bit);
            if (Words > 3 && on_arc.reduce_or() == 0) continue;  // for few words the test costs more than it saves
            (Ints::load(dual + x) + (on_arc & steps)).store(dual + x);
            for (int w = 0; w < Words; ++w)
                (Ints::load(path + w * nodes + x) ^ (on_arc & changes[w])).store(path + w * nodes + x);
        }
    }

    // Of the arcs that block at once: on the side of the column the one nearest to the apex, else on the side of the
    // row the one farthest from it.
    [[gnu::noinline]] static int last_blocking(TransportTree tree, Cycle c, double least) {
        int last = 0, best = std::numeric_limits<int>::min();
        for (int a = 0; a < Words * 32; ++a) {
            if (!c.decreasing.has(a) || tree.flow[a] != least) continue;
            const int depth = tree.path_of(tree.row_is_below.has(a) ? tree.arc[a].row : tree.arc[a].column).count();
            const int rank = c.column_part.has(a) ? tree.nodes - depth : depth - tree.nodes;
            if (rank <= best) continue;
            best = rank;
            last = a;
        }
        return last;
    }
};

}  // namespace hord::algo
