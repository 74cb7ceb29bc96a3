// The reason of a verdict in words: one sentence a part, one label a defect.
#pragma once

#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"

namespace hord::firmware {

// "Rejected: a scattering defect of 0.9 mm at (3.1, -2.0) mm, 4.2 times its limit; 2 smaller ones." Lengths in mm if
// the recipe has the lenslet pitch, else in lenslets; places from the middle of the field. A frame that was not judged:
// what was found, and the cure.
std::string explain(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents);

// The one size of a defect that people are told, lenslets: of scratches the length, of others the diameter of the disc
// that takes or bends as much light (algo::radius_of).
float size_of(const algo::Defect& defect);
std::string size_text(const algo::Defect& defect, const algo::Recipe& recipe);  // "0.9 mm", "2.3 lenslets"

// "scattering 0.9 mm, 4.2x": kind, size and how far over its limit; one a defect.
std::vector<std::string> labels_of(const algo::Inspection& found, const algo::Recipe& recipe);

}  // namespace hord::firmware
