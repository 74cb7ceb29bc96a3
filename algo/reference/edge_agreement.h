// Whether a part has edges where the reference has its own (docs/notes/reference.md, "Registration").
#pragma once

#include <algorithm>
#include <array>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

// A sample that differs by more, of the typical light or in bin pitches, disagrees. A larger step is an edge.
constexpr double kForeignLight = 0.25, kForeignBins = 0.4;

// Lenslets at edges across x and across y. Those along x say where the part lies along x.
struct EdgeAgreement {
    std::array<double, 2> edges{}, of_light{}, missing{};
    double enough = 0;  // fewer edges are specks: they say nothing

    [[nodiscard]] bool tells(std::size_t axis) const { return edges[axis] >= enough; }
    // Those of deflection alone cannot be told from a tilt.
    [[nodiscard]] bool tells_by_light(std::size_t axis) const { return of_light[axis] >= enough; }
    // Share of the edges that the part lacks, of the axis with more.
    [[nodiscard]] double missing_share() const {
        double share = 0;
        for (std::size_t axis : {0U, 1U}) share = std::max(share, tells(axis) ? missing[axis] / edges[axis] : 0);
        return share;
    }
};

// `typical`: the reference's typical light, DN. `light`: the part's light over the reference's.
EdgeAgreement compare_edges(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                            const PoseMap& map, double typical, double light);

// Whether the part's own maps show as many edges as `compare_edges` needs: an empty field does not. `typical`: the
// part's typical light, DN.
bool shows_edges(const Extents& extents, const PartMaps& part, double typical);

}  // namespace hord::algo
