// Fits the ladder of grid models to measured centres with Ceres, and chooses the rung that the image requires.
//
// A rung is chosen over the one below it when it predicts blocks of lenslets that it has not seen better: the paired
// difference of squared errors over the blocks must be positive by two of its own standard errors. Neighbouring
// residuals of real arrays are alike, so blocks are left out, not single lenslets. The last rung gives every lenslet
// its own place (calib/fit/lenslet_model.h).
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
    bool displaced = false;  // not used, but found to lie off the model: it has a place of its own (place_displaced)
    std::optional<algo::PixelPoint> split_px =
        {};  // half the difference of what two halves of its light say (CentreFinder::split)
};

// One model of the ladder and why it was, or was not, taken.
struct ModelReport {
    algo::GridModelKind model = algo::GridModelKind::similarity;
    bool single_lenslets = false;  // the last rung: the one held, and each lenslet's own shift
    int parameters = 0;
    double rms_px = 0;                        // an axis, of the fit
    double cv_x_rms_px = 0, cv_y_rms_px = 0;  // of blocks left out; infinite where they cannot be predicted
    double gain_t = 0;                        // improvement over the rung held until then, in its standard errors
    bool chosen = false;
    std::string verdict;  // one line for a person
};

[[nodiscard]] std::string_view name_of(const ModelReport& report);

// What the last rung found; all 0 where it was not taken.
struct LensletShifts {
    double rms_px = 0;  // of the lenslets' true shifts, an axis, as far as both halves of their light agree
    double share = 0;   // of a measured residual that is taken for true
    double left_x_px = 0, left_y_px = 0;  // how well another frame's centres would be predicted with them, rms
};

struct Unobservable {
    std::string name;  // of the parameter
    std::string why;
};

struct GridFit {
    algo::LensletGrid grid;  // the chosen rung
    std::vector<ModelReport> candidates;
    std::string reason;                      // why this rung, one line
    std::vector<double> sigma;               // one a parameter; 0 where it is fixed
    std::vector<double> covariance;          // row by row, parameters x parameters; 0 where fixed
    std::vector<Unobservable> unobservable;  // fixed, and not to be believed
    double noise_px = 0;                     // of one centre and axis, from the residuals
    double correlation_inflation = 1;        // of the covariance, because neighbouring residuals are alike
    double rms_x_px = 0, rms_y_px = 0, max_px = 0;
    double cv_x_rms_px = 0,
           cv_y_rms_px = 0;  // of the model without single lenslets' shifts: blocks that it has not seen
    LensletShifts shifts;
    int used = 0, displaced = 0, rejected = 0;
    int blocks = 0;  // of the cross-validation
};

struct FitOptions {
    std::optional<algo::GridModelKind> only;  // this rung, without a ladder
    algo::GridModelKind highest = algo::GridModelKind::quintic;
    bool single_lenslets = true;  // may be taken
};

// Fits centres to `frame`, of which kind, stagger, parity, size and normalisation are taken; its parameters are a
// start where it has any. Clears `used` of outliers. Fails with invalid_argument for fewer than 4 centres or values
// that are not numbers, with `refused` when no rung can be fitted. Never aborts.
Result<GridFit> fit_grid(const algo::LensletGrid& frame, std::span<Observation> observations,
                         const FitOptions& options = {});

// Gives lenslets that do not fit the model the place where they were measured, when `whole` (one a lenslet of the grid,
// row by row) says that light reaches them whole, they are off by 1/500 to 1/20 of a pitch, and both halves of their
// light (Observation::split_px) put them on the same side, each at least half as far off as the whole, and none of the
// eight lenslets about them is off. What moves one half only is dirt, what moves neighbours is in the light before the
// array (a bubble), what is further off something else. Marks them `displaced`, adds their shifts to the grid, and
// counts them out of `rejected`.
void place_displaced(std::span<Observation> observations, std::span<const std::uint8_t> whole, GridFit& fit);

// The same grid as a polynomial of `order` 1, 2 or 3 (rung affine or cubic), by robust linear least squares: a start,
// and the judge of outliers. Clears `used` of centres further off than 5 robust standard deviations.
std::optional<algo::LensletGrid> robust_polynomial(const algo::LensletGrid& frame, std::span<Observation> observations,
                                                   int order);

// The analytic derivatives of LensletGrid::at: x_px by each parameter, then y_px by each parameter.
void derivatives(const algo::LensletGrid& grid, algo::LensletGrid::Uv where, double* of_x, double* of_y);

}  // namespace hord::calib
