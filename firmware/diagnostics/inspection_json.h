// The result of an inspection as the JSON object of `hordctl inspect --json`; Python's `hord` returns the same.
#pragma once

#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware {

// name, number, version and CRC-32.
store::Json recipe_json(const NumberedRecipe& recipe);

// schema, software, grid, verdict, reason, score, defects, explain, light, feature (statistics of the map given), ms,
// recipe; bounded and pose if they apply. `bin_rad`: one bin pitch, 0 if it is not known; then the feature has no
// values in radians. Places in mm if the recipe has the lenslet pitch. `judged_by`: recipe_json() of the recipe as it
// was read, without a reference that was given beside it.
store::Json inspection_json(const algo::Inspection& found, const FeatureView& feature, double bin_rad,
                            const algo::Recipe& recipe, const store::Json& judged_by, const algo::Extents& extents);

}  // namespace hord::firmware
