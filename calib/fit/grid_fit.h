// Fits grid models to measured centres with Ceres, simplest first, and selects the one that the image requires.
//
// A model is selected over a simpler one if it predicts blocks of lenslets that were left out better: the paired
// difference of squared errors over the blocks is positive by two of its standard errors. Blocks are left out, not
// single lenslets, because neighbouring residuals are correlated. A corner of the measured area, left out whole, must
// not be predicted worse either: there a model extrapolates. The last candidate gives every lenslet a shift of its own
// (calib/fit/lenslet_model.h).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "common/result.h"

namespace hord::calib {

// One measured centre. `used` is cleared for those that the fit rejects.
struct Observation {
    int m = 0, n = 0;
    algo::PixelPoint centre_px;
    bool used = true;
    bool blemished = false;       // not used: its light has another shape than that of its neighbours (mark_blemished)
    bool beside_missing = false;  // not used: the missing light of a neighbour moves it (mark_beside_missing)
    bool unplaced = false;   // not used: as if displaced, but too far or side by side with others (place_displaced)
    bool displaced = false;  // not used: it lies off the model and has a shift of its own (place_displaced)
    std::optional<algo::PixelPoint> split_px = {};  // half the difference of its halves' centres (CentreFinder::split)
    double light_dn = 0;                            // amplitude over the background
};

// A candidate model, and why it was or was not selected.
struct ModelReport {
    algo::GridModelKind model = algo::GridModelKind::similarity;
    bool single_lenslets = false;  // the last candidate: the selected model, and a shift of each lenslet
    int parameters = 0;
    double rms_px = 0;                        // an axis, of the fitted sample
    double cv_x_rms_px = 0, cv_y_rms_px = 0;  // of blocks left out; infinite if they cannot be predicted
    double corner_px = 0;  // RMS of the worst corner of the measured area, left out whole; 0: too few lenslets for it
    double gain_t = 0;     // improvement over the model selected before, in its standard errors
    bool chosen = false;
    std::string verdict;  // one line for display
};

[[nodiscard]] std::string_view name_of(const ModelReport& report);

// Result of the last candidate; all 0 if it was not selected.
struct LensletShifts {
    double rms_px = 0;                    // of the lenslets' shifts, an axis, on which both halves of their light agree
    double share = 0;                     // of a measured residual that is used as the shift
    double left_x_px = 0, left_y_px = 0;  // predicted RMS error of the centres in another frame
};

struct Unobservable {
    std::string name;  // of the parameter
    std::string why;
};

struct GridFit {
    algo::LensletGrid grid;  // of the selected model
    std::vector<ModelReport> candidates;
    std::string reason;                      // why this model, one line
    std::vector<double> sigma;               // one a parameter; 0 where it is fixed
    std::vector<Unobservable> unobservable;  // fixed: their values mean nothing
    double noise_px = 0;                     // of one centre and axis, from the residuals
    double correlation_inflation = 1;        // factor of the covariance (inflation_of)
    double rms_x_px = 0, rms_y_px = 0, max_px = 0;
    double cv_x_rms_px = 0, cv_y_rms_px = 0;  // of blocks left out, without the lenslets' shifts
    double corner_px = 0;                     // of the worst corner, left out whole (ModelReport)
    LensletShifts shifts;
    int used = 0, displaced = 0, rejected = 0;
    int blocks = 0;  // of the cross-validation
};

// Fits a grid to the centres. Kind, stagger, parity, size and normalisation are those of `frame`, whose parameters are
// the start if it has any. Clears `used` of outliers. `models`: the candidates, simplest first. Fails with
// invalid_argument for fewer than 4 centres or values that are not numbers, with `refused` if no model can be fitted.
// Never aborts.
Result<GridFit> fit_grid(const algo::LensletGrid& frame, std::span<Observation> observations,
                         std::span<const algo::GridModelKind> models = algo::kGridModels);

// Gives displaced lenslets their measured position: those that are fully lit (`whole`, one a lenslet of the grid, row
// by row), are off the model by 1/500 to 1/20 of a pitch and by five robust standard deviations of the lenslets within
// two columns and rows (more if they are dimmer than these, by the ratio of the light), whose halves
// (Observation::split_px) are both off to the same side by at least half as much, that are not blemished, and none of
// whose eight neighbours is off the model. A shift of one half only is dirt; a shift of neighbours, too, is in the
// light in front of the array (a bubble). Marks them `displaced`, adds their shifts to the grid, and subtracts them
// from `rejected`.
void place_displaced(std::span<Observation> observations, std::span<const std::uint8_t> whole, GridFit& fit);

// The grid as a polynomial of `order` 1, 2 or 3 (model affine or cubic), by robust linear least squares: a start, and
// the reference for outliers. Clears `used` of centres off by more than 5 robust standard deviations.
std::optional<algo::LensletGrid> robust_polynomial(const algo::LensletGrid& frame, std::span<Observation> observations,
                                                   int order);

// The analytic derivatives of LensletGrid::at: x_px by each parameter, then y_px by each parameter.
void derivatives(const algo::LensletGrid& grid, algo::LensletGrid::Uv where, double* of_x, double* of_y);

}  // namespace hord::calib
