// The positions of the lenslets on the sensor, and on the measurement plane that the relay images onto them.
//
// An aligned lattice about the array's middle is foreshortened by the tilts, turned, moved and distorted, in this
// order; the result is the position of a lenslet's centre on the sensor, and, seen through the relay, on the
// measurement plane. A lenslet of a hexagonal array collects light from a rectangle of pitch by sqrt(3)/2 pitch.
#pragma once

#include <vector>

#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

class ArrayGeometry {
  public:
    explicit ArrayGeometry(const Scene& scene);

    [[nodiscard]] int width_px() const { return width_px_; }  // of the sensor
    [[nodiscard]] int height_px() const { return height_px_; }
    struct Point {
        double x = 0, y = 0;
    };
    // The centre of lenslet (m, n). (0, 0) is the centre of the top left pixel.
    [[nodiscard]] Point centre_px(int m, int n) const;
    // Pixels a bin behind lenslet (m, n).
    [[nodiscard]] double bin_px(int m, int n) const;

    // The centre on the measurement plane, and half sides of the area that the lenslet collects from.
    [[nodiscard]] Point place_mm(int m, int n) const;
    [[nodiscard]] double half_x_mm() const { return 0.5 * pitch_mm_; }
    [[nodiscard]] double half_y_mm() const { return 0.5 * pitch_mm_ * row_; }

    // The lattice place (m, n) of a point of the measurement plane: whole numbers at lenslets' centres (of the nearest
    // row's).
    [[nodiscard]] Point to_lattice(const Point& place_mm) const;

    [[nodiscard]] bool is_plain() const {
        return plain_;
    }  // square and aligned: the sensor image is a macro-pixel frame
    [[nodiscard]] bool is_dead(int m, int n) const;

  private:
    [[nodiscard]] double stagger(int n) const { return hexagonal_ ? (n % 2 != 0 ? 0.25 : -0.25) : 0; }
    [[nodiscard]] Point from_middle(int m, int n) const;  // in pitches, on the sensor

    algo::Extents extents_;
    bool hexagonal_, plain_;
    double row_, pitch_px_, pitch_mm_;
    int width_px_, height_px_;
    double xx_, xy_, yx_, yy_;           // tilts and rotation
    double offset_x_, offset_y_, half_;  // pitches
    double distortion_;
    double nearer_x_, nearer_y_;  // change of the distance to the sensor, relative, a pitch
    double dead_share_;
    std::uint64_t seed_;
    std::vector<LensletArray::Lenslet> dead_;
};

}  // namespace hord::sim
