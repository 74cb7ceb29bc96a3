#include "hal_sim/optics/scene/array_geometry.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/scene/noise.h"

namespace hord::sim {

ArrayGeometry::ArrayGeometry(const Scene& scene) : extents_(scene.camera.extents) {
    const LensletArray& array = scene.camera.array;
    hexagonal_ = array.hexagonal;
    row_ = hexagonal_ ? 0.86602540378443864676 : 1;
    pitch_px_ = array.pitch_px > 0 ? array.pitch_px : extents_.i;
    pitch_mm_ = scene.camera.field_mm / extents_.m;
    width_px_ = array.width_px > 0
        ? array.width_px
        : static_cast<int>(std::ceil(pitch_px_ * (extents_.m + (hexagonal_ ? 0.5 : 0)) - 1e-9));
    height_px_ = array.height_px > 0
        ? array.height_px
        : static_cast<int>(
              std::ceil(pitch_px_ * (row_ * (extents_.n - 1) + extents_.j / static_cast<double>(extents_.i)) - 1e-9));
    double sin_x = 0, cos_x = 1, sin_y = 0, cos_y = 1, sine = 0, cosine = 1;
    exact::sin_cos(array.tilt_x_rad, sin_x, cos_x);
    exact::sin_cos(array.tilt_y_rad, sin_y, cos_y);
    exact::sin_cos(array.rotation_rad, sine, cosine);
    // Turned about y, x is foreshortened; then the whole is rotated. Columns of the lattice, then of the rotation.
    xx_ = cosine * cos_y, xy_ = -sine * cos_x, yx_ = sine * cos_y, yy_ = cosine * cos_x;
    offset_x_ = array.offset_x_px / pitch_px_, offset_y_ = array.offset_y_px / pitch_px_;
    half_ = 0.5 * std::max(width_px_, height_px_) / pitch_px_;
    distortion_ = array.distortion;
    const double pitches_a_focal = array.focal_um > 0 ? array.pitch_um / array.focal_um : 0;
    nearer_x_ = sin_y / cos_y * pitches_a_focal, nearer_y_ = sin_x / cos_x * pitches_a_focal;
    dead_share_ = array.dead_share, dead_ = array.dead, seed_ = scene.seed;
    plain_ = !hexagonal_ && pitch_px_ == extents_.i && array.rotation_rad == 0 && array.tilt_x_rad == 0 &&
        array.tilt_y_rad == 0 && distortion_ == 0 && offset_x_ == 0 && offset_y_ == 0;
}

ArrayGeometry::Point ArrayGeometry::from_middle(int m, int n) const {
    const double u = m - 0.5 * (extents_.m - 1) + stagger(n), v = row_ * (n - 0.5 * (extents_.n - 1));
    const double x = xx_ * u + xy_ * v + offset_x_, y = yx_ * u + yy_ * v + offset_y_;
    const double stretch = 1 + distortion_ * (x * x + y * y) / (half_ * half_);
    return {x * stretch, y * stretch};
}

ArrayGeometry::Point ArrayGeometry::centre_px(int m, int n) const {
    const Point p = from_middle(m, n);
    return {0.5 * (width_px_ - 1) + pitch_px_ * p.x, 0.5 * (height_px_ - 1) + pitch_px_ * p.y};
}

double ArrayGeometry::bin_px(int m, int n) const {
    const double u = m - 0.5 * (extents_.m - 1) + stagger(n), v = row_ * (n - 0.5 * (extents_.n - 1));
    return pitch_px_ / extents_.i * (1 + nearer_x_ * u + nearer_y_ * v);
}

ArrayGeometry::Point ArrayGeometry::place_mm(int m, int n) const {
    const Point p = from_middle(m, n);
    return {pitch_mm_ * p.x, pitch_mm_ * p.y};
}

ArrayGeometry::Point ArrayGeometry::to_lattice(const Point& place_mm) const {
    const Point seen{place_mm.x / pitch_mm_, place_mm.y / pitch_mm_};
    Point p = seen;
    if (distortion_ != 0) {
        for (int step = 0; step < 12; ++step) {  // converges by a factor of 3 k1 r^2 a step
            const double stretch = 1 + distortion_ * (p.x * p.x + p.y * p.y) / (half_ * half_);
            p = {seen.x / stretch, seen.y / stretch};
        }
    }
    const double x = p.x - offset_x_, y = p.y - offset_y_, determinant = xx_ * yy_ - xy_ * yx_;
    const double u = (yy_ * x - xy_ * y) / determinant, v = (xx_ * y - yx_ * x) / determinant;
    const double n = v / row_ + 0.5 * (extents_.n - 1);
    return {u + 0.5 * (extents_.m - 1) - stagger(static_cast<int>(std::floor(n + 0.5))), n};
}

bool ArrayGeometry::is_dead(int m, int n) const {
    constexpr std::uint32_t kPurpose = 7;
    if (dead_share_ > 0 &&
        Noise(seed_, static_cast<std::uint64_t>(n) * 65536 + static_cast<std::uint64_t>(m), kPurpose).uniform() <
            dead_share_)
        return true;
    return std::any_of(dead_.begin(), dead_.end(),
                       [&](const LensletArray::Lenslet& d) { return d.m == m && d.n == n; });
}

}  // namespace hord::sim
