// Climbs the ladder of models, simplest first: fits each rung, lets it predict blocks of points that it has not seen,
// and keeps it where it does so better than the one held. Used for lenslet grids and for direction maps.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/fit/cross_validation.h"
#include "calib/fit/grid_fit.h"
#include "calib/fit/grid_solver.h"

namespace hord::calib {

struct ChosenModel {
    algo::LensletGrid grid;
    std::size_t index = 0;  // of the report in `candidates`
};
struct ModelSelection {
    std::vector<ModelReport> candidates;
    int blocks = 0;
    std::optional<ChosenModel> choice;  // none: no rung could be fitted
};

// `frame` gives what the model is made of besides its parameters; the sample is sorted into blocks.
ModelSelection select_model(const algo::LensletGrid& frame, std::vector<Point> sample, const FitOptions& options,
                            std::span<const algo::GridModelKind> models = algo::kGridModels);

}  // namespace hord::calib
