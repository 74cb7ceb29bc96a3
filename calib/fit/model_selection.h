// Selects a model: fits the candidates, simplest first, and selects one over the model selected before if it predicts
// blocks of points that were left out better. Used for lenslet grids and for direction maps.
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
    std::optional<ChosenModel> choice;  // none: no model could be fitted
};

// `frame`: everything but model and parameters. The sample is sorted into blocks.
ModelSelection select_model(const algo::LensletGrid& frame, std::vector<Point> sample,
                            std::span<const algo::GridModelKind> models);

}  // namespace hord::calib
