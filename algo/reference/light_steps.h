// A part without bevels shows its outline only by a step of the light: clear glass takes 8 %. Whether that step is as
// sharp as a part at rest shows it, and whether opposite ones lie as far apart as the reference's
// (docs/notes/reference.md, "Registration"). Steps are smaller than the edges of edge_places.h, so that lines across
// the outline are compared with what a sharp step shows in lenslets, and not with the reference's mean over poses.
#pragma once

#include "algo/frame/extents.h"
#include "algo/reference/edge_blur.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"
#include "algo/reference/size_difference.h"

namespace hord::algo {

struct LightSteps {
    SizeDifference size;
    EdgeBlur blur;
};

// Along axes where the reference has no such steps, or too few, nothing is known. `typical`: the reference's typical
// light, DN. `light`: the part's light over the reference's.
LightSteps compare_light_steps(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                               const PoseMap& map, double typical, double light);

}  // namespace hord::algo
