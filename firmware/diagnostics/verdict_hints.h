// What the reason of a reject may be beside a defect of the part: a bevel, the walls of a tube, moved optics.
#pragma once

#include <string>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"

namespace hord::firmware {

// `found`: rejected, with a defect at least. Each is a sentence of its own after a blank, or "".
std::string hint(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e);
std::string fewer_bits_hint(const algo::FrameFindings& frame);  // of a dim frame
std::string moved_optics(const algo::Inspection& found);

// Of a tube that is compared with itself: the light of the worst defect is there, and it is half as long as the field.
bool is_along_tube(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e);

}  // namespace hord::firmware
