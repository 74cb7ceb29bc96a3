// Which two lenslets a gradient compares along an axis.
//
// Central: the ones before and after (offsets -1 and +1). If one of them has no HORD (dark, saturated) the middle one
// takes its place: the difference over one lenslet, counted twice, so that every gradient is per two lenslets and a
// smooth field keeps its value beside a hole. With neither there is no gradient, and at the field's edge none is
// attempted: nothing is invented where there was no light. The caller has checked that the middle one has a HORD.
//
// The central form does not look at the middle lenslet: a defect of one lenslet shows as its four neighbours, which
// touch at their corners and so are one region around the true place.
#pragma once

namespace hord::algo {

struct Stencil {
    int before = -1;  // offsets, lenslets
    int after = 1;

    [[nodiscard]] constexpr bool valid() const { return before != after; }
    // What a difference is multiplied by to be per two lenslets.
    [[nodiscard]] constexpr int weight() const { return 2 / (after - before); }
};

constexpr Stencil stencil(bool has_before, bool has_after) { return {has_before ? -1 : 0, has_after ? 1 : 0}; }

}  // namespace hord::algo
