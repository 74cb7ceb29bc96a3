// Why a frame was not judged, and the cure.
#pragma once

#include <string>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"

namespace hord::firmware {

// The rest of "Not judged: ...": no capital, no full stop. `found`: unfit.
std::string why_unfit(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents);

}  // namespace hord::firmware
