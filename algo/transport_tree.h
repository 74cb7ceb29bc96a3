// The spanning tree of a transportation simplex, and its pivot.
//
// Nodes are rows and columns of the transport problem; every node but the root has an arc to its parent that carries a flow.
// The tree is strongly feasible (Cunningham 1976): an arc that carries nothing always has its row below its column, and so points
// to the root; the leaving arc is the last blocking one along the cycle from its apex. So no tree ever comes twice.
//
// Flows are integers below 2^53 held in doubles: exact.
#pragma once

#include <cstdint>
#include <limits>

#include "algo/isa_targets.h"

namespace hord::algo {

template <int Words>
struct NodeSet {
    std::uint64_t word[Words];

    HORD_ALWAYS_INLINE static NodeSet only(int node) {
        NodeSet set{};
        set.word[node / 64] = std::uint64_t{1} << (node % 64);
        return set;
    }
    [[nodiscard]] HORD_ALWAYS_INLINE bool has(int node) const { return (word[node / 64] >> (node % 64) & 1U) != 0; }
    HORD_ALWAYS_INLINE void add(const NodeSet& other) {
        for (int w = 0; w < Words; ++w) word[w] |= other.word[w];
    }
    HORD_ALWAYS_INLINE void remove(const NodeSet& other) {
        for (int w = 0; w < Words; ++w) word[w] &= ~other.word[w];
    }
};

template <int Words>
struct TreeNode {
    NodeSet<Words> below;  // the nodes of its subtree, itself included
    double flow;           // on the arc to its parent
    int parent;            // kNoParent: the root
};
constexpr int kNoParent = -1;

// What a pivot did: the nodes that now hang elsewhere, and whether they are those on the column's side of the entering arc.
template <int Words>
struct Moved {
    NodeSet<Words> nodes;
    bool with_column;
};

// The arc between `row` and `column` enters. `path` has room for all nodes, twice.
template <int Words>
HORD_ALWAYS_INLINE Moved<Words> pivot(TreeNode<Words>* tree, int row, int column, int* path) {
    // Mass circulates apex -> ... -> row -> column -> ... -> apex. The arcs it runs against give way: on either side those of
    // every other node, from the first.
    double least = std::numeric_limits<double>::infinity();
    int* const row_side = path;
    int row_length = 0, leave_at = 0;
    for (int x = row; !tree[x].below.has(column); x = tree[x].parent) {
        if (row_length % 2 == 0 && tree[x].flow < least) {
            least = tree[x].flow;
            leave_at = row_length;
        }
        row_side[row_length++] = x;
    }
    bool with_column = false;
    int* const column_side = row_side + row_length;
    int column_length = 0;
    for (int x = column; !tree[x].below.has(row); x = tree[x].parent) {
        if (column_length % 2 == 0 && tree[x].flow <= least) {
            least = tree[x].flow;
            leave_at = column_length;
            with_column = true;
        }
        column_side[column_length++] = x;
    }
    const int* const stem = with_column ? column_side : row_side;  // its nodes up to the leaving arc turn around
    const int* const hook = with_column ? row_side : column_side;
    const int stem_length = with_column ? column_length : row_length;
    const int hook_length = with_column ? row_length : column_length;

    const NodeSet<Words> moved = tree[stem[leave_at]].below;
    double change = -least;
    for (int k = 0; k < hook_length; ++k, change = -change) {
        TreeNode<Words>& node = tree[hook[k]];
        node.flow += change;
        node.below.add(moved);
    }
    change = (leave_at % 2 * 2 - 1) * -least;  // of the node after the leaving arc
    for (int k = leave_at + 1; k < stem_length; ++k, change = -change) {
        TreeNode<Words>& node = tree[stem[k]];
        node.flow += change;
        node.below.remove(moved);
    }
    int parent = with_column ? row : column;
    double carried = least;
    NodeSet<Words> previous{};  // what was below the node before
    change = -least;
    for (int k = 0; k <= leave_at; ++k, change = -change) {
        TreeNode<Words>& node = tree[stem[k]];
        const double flow = node.flow + change;
        const NodeSet<Words> was = node.below;
        node.below = moved;
        node.below.remove(previous);
        node.parent = parent;
        node.flow = carried;
        previous = was;
        carried = flow;
        parent = stem[k];
    }
    return {moved, with_column};
}

}  // namespace hord::algo
