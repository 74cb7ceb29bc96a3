// Whether a frame's light is rather an empty field's than that of a reference's part, where no edge tells.
#pragma once

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

// A clear plate without bevels takes 8 % of the light, and its outline shows no edge: an empty field fits the reference
// at any pose. The light s of the frame's lenslets is fitted by a R + b, where R is the reference's light at the pose
// `map`. A good part has b = 0, an empty field a = 0; the share b of the mean light says which of the two is nearer.
// Fitted for the whole field and for each of its quarters: of half a part, two are empty.
//
// True if a share is above a half and its standard error below a sixteenth, from 8x8 cells of the field: neighbours may
// deviate together. False if the reference's light varies too little to tell, and where its `parts` good parts leave
// too much noise in R. `reference`: R without errors of its pose; both: one value a lenslet. The empty field's light
// must be even: where it falls off to the borders, fewer empty fields are recognised.
bool is_rather_empty(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                     double electrons_per_dn, std::uint32_t parts);

}  // namespace hord::algo
