// The light in the bins of one lenslet: rays where the part is smooth, ever smaller cells where it is not.
//
// A cell is a rectangle of positions in the lenslet and a box of slopes. Nine rays, its centre and half of its sixteen
// corners (the two-level design 2^(4-1), resolution IV), say what the part does to it:
//   - every ray of one path, bent alike: the source's disc, mapped back linearly, is cut by the bins exactly (source_area.h);
//   - slopes that no path brings near the source are dark, and the box shrinks to the rest;
//   - rays of different paths (an edge runs through the cell), or bent too differently: the cell is halved where they differ,
//     and when it holds only a small share of a bin, sampled evenly.
// Cells that may hold a defect smaller than themselves are halved whatever the nine rays say (Feature::resolution).
#pragma once

#include <vector>

#include "hal_sim/optics/camera.h"
#include "hal_sim/optics/source_area.h"

namespace hord::sim {

class LensletLight {
  public:
    explicit LensletLight(const Scene& scene);

    // Fills bins[j * extents.i + i] of lenslet (m, n), 1 for a bin filled by the source. Any thread.
    void collect(int m, int n, double* bins) const;

  private:
    struct Cell;
    struct Samples;
    void collect(const Cell& cell, const std::vector<const Feature*>& near, double* bins) const;
    [[nodiscard]] Samples sample(const Cell& cell) const;
    [[nodiscard]] bool is_near(const Cell& cell, const Feature& feature) const;
    [[nodiscard]] SlopeBox shrink(const Cell& cell, const Samples& samples) const;
    void add_smooth(const Cell& cell, const Samples& samples, double* bins) const;
    void add_sampled(const Cell& cell, double rays_per_bin, double* bins) const;
    void halve(const Cell& cell, int axis, const std::vector<const Feature*>& near, double* bins) const;

    algo::Extents extents_;
    CameraGeometry camera_;
    Body body_, clean_;
    double source_radius_;
    double bin_rad_;
};

}  // namespace hord::sim
