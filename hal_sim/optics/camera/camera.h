// The geometry of the light-field camera: maps each ray to a lenslet and a bin. Bin (i,j) of lenslet (m,n) is a cell
// of a regular grid in four dimensions: position on the measurement plane, slope there. In a conventional plenoptic
// camera the offset of a slope depends on the place, too (docs/notes/optics.md).
#pragma once

#include "hal_sim/optics/scene/array_geometry.h"
#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {

// Positions in millimetres on the measurement plane, slopes in bin pitches, both in the camera's frame.
class CameraGeometry {
  public:
    explicit CameraGeometry(const Scene& scene);

    [[nodiscard]] double pitch_mm() const { return pitch_mm_; }
    // Of an aligned square array.
    [[nodiscard]] double lenslet_x_mm(int m) const { return (m - 0.5 * (extents_.m - 1)) * pitch_mm_; }
    [[nodiscard]] double lenslet_y_mm(int n) const { return (n - 0.5 * (extents_.n - 1)) * pitch_mm_; }
    // A lenslet's place on the measurement plane: centre and half sides.
    struct Place {
        double x_mm, y_mm, half_x_mm, half_y_mm;
    };
    [[nodiscard]] Place place_of(int m, int n) const {
        if (array_.is_plain()) return {lenslet_x_mm(m), lenslet_y_mm(n), 0.5 * pitch_mm_, 0.5 * pitch_mm_};
        const ArrayGeometry::Point at = array_.place_mm(m, n);
        return {at.x, at.y, array_.half_x_mm(), array_.half_y_mm()};
    }
    [[nodiscard]] const ArrayGeometry& array() const { return array_; }

    // Converts to the part's frame, and the slope of the light back to the camera's.
    [[nodiscard]] CameraRay to_part(double x_mm, double y_mm, double u_bins, double v_bins) const {
        const double x = x_mm - shift_x_, y = y_mm - shift_y_, u = (u_bins - offset(x_mm)) * bin_rad_,
                     v = (v_bins - offset(y_mm)) * bin_rad_;
        return {cosine_ * x + sine_ * y, cosine_ * y - sine_ * x, cosine_ * u + sine_ * v, cosine_ * v - sine_ * u};
    }
    // Offset of undeflected light behind a lenslet at this position, bins; 0 in the 4f camera.
    [[nodiscard]] double offset(double place_mm) const { return offset_a_mm_ * place_mm; }
    void position_to_camera(double x, double y, double& x_mm, double& y_mm) const {
        x_mm = cosine_ * x - sine_ * y + shift_x_;
        y_mm = cosine_ * y + sine_ * x + shift_y_;
    }
    void to_camera(double u, double v, double& u_bins, double& v_bins) const {
        u_bins = (cosine_ * u - sine_ * v) / bin_rad_;
        v_bins = (cosine_ * v + sine_ * u) / bin_rad_;
    }

  private:
    algo::Extents extents_;
    ArrayGeometry array_;
    double pitch_mm_, bin_rad_;
    double offset_a_mm_ = 0;  // bins a mm
    double shift_x_, shift_y_, sine_ = 0, cosine_ = 1;
};

}  // namespace hord::sim
