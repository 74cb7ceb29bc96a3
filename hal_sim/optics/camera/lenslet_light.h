// The light in the bins of one lenslet: rays where the part is smooth, ever smaller cells where it is not.
//
// A cell is a rectangle of positions in the lenslet and a box of slopes. Nine rays, its centre and half of its sixteen
// corners (the two-level design 2^(4-1), resolution IV), say what the part does to it:
//   - every ray of one path, bent alike: the source's disc, mapped back linearly, is cut by the bins exactly
//   (source_area.h);
//   - slopes that no path brings near the source are dark, and the box shrinks to the rest;
//   - rays of different paths (an edge runs through the cell), or bent too differently: the cell is halved where they
//   differ,
//     and when it holds only a small share of a bin, sampled evenly.
// Cells that may hold a defect smaller than themselves are halved whatever the nine rays say (Feature::resolution), and
// so are cells through which the edge of an obstacle runs.
//
// The light is a sum over passes, each a source at one wavelength, a place of the moving part, and a way of the light:
// the refracted one, or a ghost. A scene that names no such effect has one pass.
#pragma once

#include <memory>
#include <vector>

#include "hal_sim/optics/camera/camera.h"
#include "hal_sim/optics/camera/diffraction.h"
#include "hal_sim/optics/camera/obstacles.h"
#include "hal_sim/optics/camera/source_area.h"

namespace hord::sim {

class LensletLight {
  public:
    // `grid`: the step and the size of the grids to be filled.
    LensletLight(const Scene& scene, const SlopeGrid& grid);
    explicit LensletLight(const Scene& scene) : LensletLight(scene, SlopeGrid::of(scene.camera.extents)) {}

    // Fills cells[l * grid.i + k] with the light of slopes within `range`, 1 for a full bin's area of light. Any
    // thread.
    void collect(const CameraGeometry::Place& lenslet, const SlopeGrid& grid, const SlopeBox& range,
                 double* cells) const;

    // The bins of lenslet (m, n): bins[j * extents.i + i].
    void collect(int m, int n, double* bins) const;

  private:
    class Gathering;
    // The part in light of one wavelength.
    struct Optics {
        double wavelength_nm;
        Body body, clean;
        std::unique_ptr<Diffraction> diffraction;  // or none
    };
    struct Pass {
        const Optics* optics;
        double s, t, radius, power;  // the source: direction and radius in bins, in the camera's frame
        double shift_x, shift_y;     // of the part, mm
        Ghost ghost;
    };

    algo::Extents extents_;
    CameraGeometry camera_;
    Obstacles obstacles_;
    double bin_rad_;
    std::vector<std::unique_ptr<Optics>> optics_;
    std::vector<Pass> passes_;  // those of one wavelength together
};

}  // namespace hord::sim
