// The light in the bins of one lenslet, by adaptive subdivision of its positions and slopes into cells
// (lenslet_cell.h). The rules of subdivision: docs/notes/optics.md.
//
// The light is a sum over passes: a source at one wavelength, a place of the moving part, and a path of the light, the
// refracted one or a ghost. A scene without such effects has one pass (lenslet_passes.cpp).
#pragma once

#include <memory>
#include <vector>

#include "hal_sim/optics/camera/camera.h"
#include "hal_sim/optics/camera/obstacles.h"
#include "hal_sim/optics/camera/slope_blur.h"
#include "hal_sim/optics/camera/source_area.h"

namespace hord::sim {

struct LensletCell;

class LensletLight {
  public:
    // `grid`: step and size of the grids that collect() fills.
    LensletLight(const Scene& scene, const SlopeGrid& grid);
    explicit LensletLight(const Scene& scene) : LensletLight(scene, SlopeGrid::of(scene.camera.extents)) {}

    // Fills cells[l * grid.i + k] with the light of slopes within `range`, 1 for a full bin's area of light.
    // Thread-safe.
    void collect(const CameraGeometry::Place& lenslet, const SlopeGrid& grid, const SlopeBox& range,
                 double* cells) const;

  private:
    class Gathering;
    struct Scattering {
        SlopeBlur blur;
        Body opaque;  // the part, but no light passes the haze
        Feature haze;
    };
    // The part in light of one wavelength.
    struct Optics {
        double wavelength_nm;
        Body body, clean;
        std::unique_ptr<SlopeBlur> diffraction;  // null without diffraction
        std::unique_ptr<Scattering> scattering;  // null without haze
    };
    struct Pass {
        const Optics* optics;
        double s, t, radius, power;  // the source: direction and radius in bins, in the camera's frame
        double shift_x, shift_y;     // of the part, mm
        Ghost ghost;
    };

    void add_scattered(const Pass& pass, const SlopeGrid& grid, const LensletCell& whole,
                       const std::vector<const Feature*>& near, double* cells) const;

    CameraGeometry camera_;
    Obstacles obstacles_;
    double bin_rad_;
    std::vector<std::unique_ptr<Optics>> optics_;
    std::vector<Pass> passes_;  // sorted by wavelength
};

}  // namespace hord::sim
