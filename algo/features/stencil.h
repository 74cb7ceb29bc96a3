// The two lenslets that a gradient compares along an axis.
//
// Central: the lenslets before and after (offsets -1 and +1). If one has no HORD (dark, saturated), the middle lenslet
// replaces it: the difference over one lenslet has weight 2, so that all gradients are per two lenslets. If both have
// none, there is no gradient; nor at the edge of the field. The caller has checked that the middle lenslet has a HORD.
//
// The central form does not use the middle lenslet: a defect of one lenslet shows in its four neighbours, which touch
// at their corners and so form one region around it.
#pragma once

#include <cassert>

namespace hord::algo {

struct Stencil {
    int before = -1;  // offsets, lenslets
    int after = 1;

    [[nodiscard]] constexpr bool valid() const { return before != after; }
    // Factor that makes a difference per two lenslets. Only for a valid stencil.
    [[nodiscard]] constexpr int weight() const {
        assert(valid());
        return 2 / (after - before);
    }
};

constexpr Stencil stencil(bool has_before, bool has_after) { return {has_before ? -1 : 0, has_after ? 1 : 0}; }

}  // namespace hord::algo
