// What a reject shows along the outline of a part: the bevel of a plate, whose defect surrounds the part, so that the
// middle of the defect is no place of it.
#pragma once

#include <cstddef>
#include <optional>

#include "algo/frame/extents.h"
#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"

namespace hord::firmware {

// Lenslets that lie along the rim from there inwards.
struct AlongOutline {
    int width = 0;          // lenslets beyond the rim, at its widest; 0: no more of the outline than a place takes
    bool at_least = false;  // of a verdict by bounds: `width` is that of the features that are exact
    double share = 0;       // of the outline
    std::size_t worst = 0;  // lenslet
};

// More than half of the judged lenslets have less light than the recipe allows: it is measured by the brightest tenth
// (algo/features/transmission.h), which may be a hole.
bool is_mostly_dark(const algo::Inspection& found, const algo::Recipe& recipe);

// Those without light, or with less than the recipe allows.
AlongOutline dark_along_outline(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e);

// Those that exceed a limit, if the worst lenslet of the part is one of them. None with a reference, whose defects are
// found otherwise, and of tubes and webs.
std::optional<AlongOutline> defect_along_outline(const algo::Inspection& found, const algo::Recipe& recipe,
                                                 const algo::Extents& e);

}  // namespace hord::firmware
