// One choice of a cell, and its scenes.
#pragma once

#include <string>

#include "hal_sim/optics/scene/scene.h"
#include "lab/design/wanted_defect.h"

namespace hord::lab {

// The camera that the cell is built with.
struct CameraLimits {
    double pixels = 25e6;
    int bits = 12;
    double full_well_e = 10'000;
    double read_e = 3;
    double pixel_um = 3.45;
    bool diffraction = true;     // simulated; haze cannot be rendered with it
    double fastest_lenslet = 1;  // f-number that can be bought
};

struct CellChoice {
    int bins = 9;                  // a side
    double bin_pitch_rad = 0.015;  // slope of a bin
    double pixels_share = 1;       // of the camera's width that is used: 0.5 has half as many lenslets a side
    double source_radius_bins = 0.61;
    double light = 1;  // of the exposure that fills a bin to 94 % of the full scale
    friend bool operator==(const CellChoice&, const CellChoice&) = default;
};

// Of the optics to order: the lenslets' pitch and focal length, and the relay's magnification f2/f1.
struct CellOptics {
    double lenslet_um = 0, focal_um = 0, magnification = 0;
    [[nodiscard]] double f_number() const { return focal_um / lenslet_um; }
};
CellOptics optics_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera);

int lenslets_of(const CellChoice& cell, const CameraLimits& camera);  // a side, odd
// "9x9 bins of 15 mrad, 555x555 lenslets of 0.043 mm, ..."
std::string describe(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera);
// Why this cell is not worth a simulation; empty if it is. `largest_slope`: of the clean part's light, rad.
std::string problem_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera,
                       double largest_slope);

// The part before this camera: its own light, glass, pose and noise, without relay, dust, motion and array.
sim::Scene scene_of(const CellChoice& cell, const sim::Scene& part, const CameraLimits& camera);
// A square of `lenslets` (odd) about lenslet (m, n) of a scene from scene_of(): the same light as there, for the
// lenslets (m - lenslets / 2 ... m + lenslets / 2).
sim::Scene window_of(const sim::Scene& scene, int m, int n, int lenslets);

}  // namespace hord::lab
