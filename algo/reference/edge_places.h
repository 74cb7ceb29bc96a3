// Where a reference's light has edges across an axis, and what a registered part shows there.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

// A lenslet of the part where the reference has an edge.
struct EdgePlace {
    double m, n;   // in the reference
    double value;  // the part's light over the typical light
};

// About kMax lenslets, evenly over all edges across one axis, before and behind the middle of these.
struct EdgePlaces {
    static constexpr std::size_t kMax = 256;
    std::array<std::array<EdgePlace, kMax>, 2> of;
    std::array<std::size_t, 2> count{};

    [[nodiscard]] std::span<const EdgePlace> side(std::size_t which) const {
        return std::span(of[which]).first(count[which]);
    }

    // False if the edges are so few that they are specks. `axis`: 0 for edges across x, 1 across y. `typical`: the
    // reference's typical light, DN. `light`: the part's light over the reference's. Precondition: empty.
    bool collect(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                 std::size_t axis, double typical, double light);
};

}  // namespace hord::algo
