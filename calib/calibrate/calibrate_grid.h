// Calibrates the lenslet grid from a white frame: lattice, centres, model. Hints are optional.
//
//     auto calibration = calibrate_grid(white, dark);
//     if (!calibration) ...error().message() names the reason...
//     write_grid("grid.toml", *calibration, stamp);   // calib/files/grid_toml.h
#pragma once

#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/fit/grid_fit.h"
#include "calib/lattice/centres.h"
#include "calib/lattice/lattice.h"
#include "calib/lattice/row_shift.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::calib {

struct GridOptions {
    LatticeHint hint;
    std::optional<FrameView> flat;              // response of each pixel to even light, without lenslets
    std::function<void(double done)> progress;  // 0..1, from the calling thread; may be empty
};

// What the mean lenslet looks like, by its harmonics at the lattice's frequencies, as shares of their power.
struct PatternShape {
    double wave_share = 0;   // of the fundamentals: 1 for gratings, and for lenslets blurred to waves
    double first_share = 0;  // of the first harmonics in both steps (square lattices): 1 for crossed gratings
    // Of those that a shift to the middle of four lenslets (square lattices) or of three (hexagonal) leaves: 0 for a
    // checkerboard, 1 if that middle looks as the lenslets do.
    double even_share = 0;
    // Light half way to the neighbours, over that in the middle, both less that of the places farthest from all
    // lenslets: 1 if what lies between dark dots was taken for lenslets.
    double between = 0;
    double dark_share = 1;  // of the lattice's cell: below half of the light
    // Light in the middle of four lenslets (of three of a hexagonal lattice), over that in a lenslet, both less that
    // half way to the neighbours: 1 if other fields lie there, as in a checkerboard, 0 or less if it is dark.
    double second = 0;
    // How much the mean lenslet of a square lattice changes when the lattice is turned by 90 degrees: squared
    // differences of the real parts of its harmonics, over twice their power. Two exposures move along one direction
    // only. 0 of a hexagonal lattice: its lenslets may be squares, which a turn by 60 degrees changes.
    double unequal = 0;
    double corners = 0;  // of the lenslets; below 0: they are stars, with rays towards their neighbours
};

// How far the centres' residuals follow the gradient of the light between neighbours: in a white frame not at all.
struct LightFollowing {
    double share = 0;  // of the residuals' power, 0..1
    double px = 0;     // RMS of that part
    // How far a centre moves, px, where the light changes by 1 from lenslet to lenslet, relative to itself.
    double slope_px = 0;
};

// How far residuals are alike from neighbour to neighbour: those of misplaced lenslets are not, those of bent light
// are.
struct SmoothResiduals {
    double correlation = 0;  // of neighbours, -1..1
    double px = 0;           // RMS of the common part
    int pairs = 0;           // of neighbours
};

// How the lenslets' light is narrower along the way to one place in or near the frame than across, in proportion to the
// squared distance: cat's-eye vignetting (or distortion that scales the lenslets) makes them so.
struct CutLenslets {
    // Than whole lenslets are, at half a diagonal from that place: share of the moments (Elongation); below 0: wider.
    struct Beyond {
        double narrower = 0;
        double sigma = 0;   // standard error of `narrower`, from how regions of the frame differ from the law
        double spread = 0;  // how far the shape of whole lenslets may be off
        // How the shape changes evenly over the frame, at half a diagonal from its middle, beyond how that of whole
        // lenslets does and may be off: a stop far to one side makes it so. And its standard error.
        double uneven = 0, uneven_sigma = 0;
    };
    Beyond one_size;  // than whole lenslets of one size everywhere, beside their neighbours
    Beyond scaled;    // than those that a relay lens scales as it scales their distances
    // How all lenslets are longer in the same direction, beyond the lattice's own steps: moved, or exposed twice.
    double elongated = 0;
};

// How much more the lenslets' edges are blurred one way than across, the same way for all: exposed twice, or moved.
// px^2 of variance. All 0 where lenslets are spots (CutLenslets::elongated).
struct EdgeBlur {
    double more_px2 = 0;  // along the way, less across
    double sigma_px2 = 0;
    double own_px2 = 0;  // mean of all ways
    // How far two exposures lie apart that blur edges so.
    [[nodiscard]] double apart_px() const { return 2 * std::sqrt(more_px2); }
};

// Light that is brighter on the same side of all lenslets: what of their light a half turn about the centres changes is
// fitted by a shift and a gradient of that light. Of spots, which show no difference between the two, `left_share`
// only. A second, weaker exposure leaves more.
struct OddLight {
    algo::PixelPoint shift_px;     // from the measured centres to the lenslets
    double sigma_px = 0;           // standard error
    double unsure_px = 0;          // a shift that has as much light as the fit leaves
    double left_share = 0;         // light that the fit leaves, of the power of all
    algo::PixelPoint gradient;     // relative change of the light a pixel
    algo::PixelPoint by_light_px;  // what that gradient makes of a lenslet's measured centre, with the sign of shift_px
    [[nodiscard]] double shift() const { return std::hypot(shift_px.x_px, shift_px.y_px); }
    // The shift is there, and half of it or less is unsure.
    [[nodiscard]] bool known() const;
    // The shift is there, and most of it is what the gradient makes.
    [[nodiscard]] bool by_light() const;
};

struct GridCalibration {
    Lattice lattice;                        // before the fit
    GridFit fit;                            // grid, candidate models, covariance, residuals
    std::vector<Observation> observations;  // every lenslet measured; those not `used` are outliers of the fit
    Immunity immunity;                      // of the centres against gradients

    double pitch_px = 0;      // mean of the grid's two pitches at its middle
    double rotation_rad = 0;  // of the lattice's rows (columns where these are staggered), x towards y
    int inside = 0;           // lenslets of the grid whose centre is inside the frame
    int complete = 0;         // lenslets whose whole window is inside the frame
    int found = 0;            // of the complete ones, those measured
    int missing = 0;          // of the complete ones, those not measured: dead, dark, or unlike the others
    int displaced = 0;        // of the found ones, those off the model with a shift of their own (place_displaced)
    int rejected = 0;         // of the found ones, the other outliers
    int blemished = 0;        // of the rejected ones, those whose light has another shape than that of their neighbours
    int beside_missing = 0;   // of the rejected ones, those that the missing light of a dead neighbour moves
    int saturated = 0;        // of the found ones, those with saturated samples
    int apart = 0;            // of the found ones, those that no chain of lit neighbours joins to the others
    int torn = 0;             // pairs of neighbours that are not one local pitch apart
    int whole = 0;            // of the complete ones, those fully lit (calib/lattice/lenslet_coverage.h)
    int whole_found = 0;      // of the fully lit ones, those measured
    int whole_placed = 0;     // of these, those that fit or are `displaced`

    std::vector<algo::PixelPoint> missing_px;  // where the grid places the missing ones
    PatternShape shape;
    // RMS difference of a lenslet's light from its neighbours', over its own, without the noise of both.
    double light_roughness = 0;
    // How much the light of all lenslets is brighter on the same side: its change from the middle to the half height,
    // over the mean. 0 where lenslets are spots, which move instead.
    double one_sided = 0;
    // How far the fall-off of the light over the frame can move centres, at the most: 0 where they are immune to it.
    double by_fall_off_px = 0;
    LightFollowing light_following;
    SmoothResiduals smooth_residuals;
    CutLenslets cut;
    EdgeBlur edge_blur;
    EdgeBlur diagonal_blur;  // the same along the lattice's diagonals, of square lenslets; 0 of others
    RowShift row_shift;
    OddLight odd_light;
    std::vector<std::string> warnings;  // sentences for a person: the grid is usable, but something is unusual

    struct Node {
        int m = 0, n = 0;
        algo::PixelPoint centre_px;  // of the grid model
        bool found = false;          // measured, and used by the fit or displaced
    };
    // Every lenslet of the grid inside the frame, row by row.
    [[nodiscard]] std::vector<Node> nodes() const;
};

// Frames have 8 to 16 bits and at least 24 px a side. Fails with `refused`, naming reason and cure, if the frame shows
// no single lenslet lattice, its centres do not fit one, the grid does not reach all of the lit lenslets, or the
// pattern is not that of lenslets.
Result<GridCalibration> calibrate_grid(const FrameView& white, const std::optional<FrameView>& dark = {},
                                       const GridOptions& options = {});

}  // namespace hord::calib
