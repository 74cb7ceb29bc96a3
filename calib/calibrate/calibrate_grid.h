// From a white frame to the lenslet grid: lattice, centres, model. Needs no hints.
//
//     auto calibration = calibrate_grid(white, dark);
//     if (!calibration) ...error().message() says why the frame is refused...
//     write_grid("grid.toml", *calibration, stamp);   // calib/files/grid_toml.h
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"
#include "calib/lattice/centres.h"
#include "calib/lattice/lattice.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::calib {

struct GridOptions {
    LatticeHint hint;
    FitOptions fit;
    std::optional<FrameView> flat;              // what each pixel makes of even light, without lenslets
    std::function<void(double done)> progress;  // 0..1, from the calling thread; may be empty
};

struct GridCalibration {
    Lattice lattice;                        // as first seen, before the fit
    GridFit fit;                            // grid, ladder, covariance, residuals
    std::vector<Observation> observations;  // every lenslet found; those not `used` are outliers of the fit
    Immunity immunity;                      // of the centres against gradients

    double pitch_px = 0;      // mean of the grid's two pitches at its middle
    double rotation_rad = 0;  // of the lattice's rows (columns where these are staggered), x towards y
    int inside = 0;           // lenslets of the grid whose centre lies inside the frame
    int complete = 0;         // those whose whole window does
    int found = 0;            // of the complete ones, those measured
    int missing = 0;          // of the complete ones, those without a centre: dead, dark, or unlike the others
    int displaced =
        0;  // of the found ones, those that lie off the model and have a place of their own (place_displaced)
    int rejected = 0;      // of the found ones, those that do not fit otherwise
    int saturated = 0;     // of the found ones, those with saturated samples
    int whole = 0;         // of the complete ones, those that light reaches whole (calib/lattice/lenslet_coverage.h)
    int whole_found = 0;   // of these, those measured
    int whole_placed = 0;  // of these, those that fit, or are displaced and have a place of their own

    struct Node {
        int m = 0, n = 0;
        algo::PixelPoint centre_px;  // of the grid model
        bool found = false;          // measured there, and used by the fit or displaced
    };
    // Every lenslet of the grid inside the frame, row by row.
    [[nodiscard]] std::vector<Node> nodes() const;
};

// Frames are 8 to 16 bit and at least 24 px a side. Fails with `refused`, naming the reason and the cure, when the
// frame shows no single lenslet lattice, or its centres do not lie on one.
Result<GridCalibration> calibrate_grid(const FrameView& white, const std::optional<FrameView>& dark = {},
                                       const GridOptions& options = {});

}  // namespace hord::calib
