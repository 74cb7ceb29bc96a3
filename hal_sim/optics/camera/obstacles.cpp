#include "hal_sim/optics/camera/obstacles.h"

#include <algorithm>
#include <cmath>

namespace hord::sim {

Obstacles::Obstacles(const Scene& scene) {
    const Relay& relay = scene.camera.relay;
    const double slope = relay.f1_mm * scene.camera.bin_pitch_rad, magnification = relay.f2_mm / relay.f1_mm;
    const auto plane = [&](Dust::Plane at) -> Disc {
        switch (at) {
            case Dust::Plane::lens1: return {1, slope, 0, 0, 0, 1, 0};
            case Dust::Plane::stop: return {0, slope, 0, 0, 0, 1, 0};
            case Dust::Plane::lens2: return {-magnification, slope, 0, 0, 0, 1, 0};
            case Dust::Plane::lenslets: return {magnification, 0, 0, 0, 0, 1, 0};
        }
        return {};
    };
    const auto opening = [&](Dust::Plane at, double radius) {
        if (!(radius > 0)) return;
        discs_.push_back(plane(at));
        discs_.back().radius = radius;
    };
    opening(Dust::Plane::stop, relay.stop_radius_mm);
    opening(Dust::Plane::lens1, relay.lens1_radius_mm);
    opening(Dust::Plane::lens2, relay.lens2_radius_mm);
    for (const Dust& dust : scene.camera.dust) {
        Disc disc = plane(dust.plane);
        disc.x = dust.x_mm, disc.y = dust.y_mm, disc.radius = dust.radius_mm;
        disc.inside = dust.transmission, disc.outside = 1;
        discs_.push_back(disc);
    }
}

double Obstacles::transmission(double x_mm, double y_mm, double u_bins, double v_bins) const {
    double passes = 1;
    for (const Disc& d : discs_) {
        const double x = d.of_place * x_mm + d.of_slope * u_bins - d.x,
                     y = d.of_place * y_mm + d.of_slope * v_bins - d.y;
        passes *= x * x + y * y < d.radius * d.radius ? d.inside : d.outside;
    }
    return passes;
}

double Obstacles::transmission(double x_mm, double y_mm, double half_x_mm, double half_y_mm,
                               const SlopeBox& box) const {
    double passes = 1;
    bool edge = false;
    for (const Disc& d : discs_) {
        const double x = std::abs(d.of_place * x_mm + d.of_slope * 0.5 * (box.u0 + box.u1) - d.x);
        const double y = std::abs(d.of_place * y_mm + d.of_slope * 0.5 * (box.v0 + box.v1) - d.y);
        const double half_x = std::abs(d.of_place) * half_x_mm + std::abs(d.of_slope) * 0.5 * (box.u1 - box.u0);
        const double half_y = std::abs(d.of_place) * half_y_mm + std::abs(d.of_slope) * 0.5 * (box.v1 - box.v0);
        const double far_x = x + half_x, far_y = y + half_y, near_x = std::max(x - half_x, 0.0),
                     near_y = std::max(y - half_y, 0.0);
        const double square = d.radius * d.radius;
        if (far_x * far_x + far_y * far_y < square) passes *= d.inside;
        else if (near_x * near_x + near_y * near_y >= square) passes *= d.outside;
        else edge = true;
    }
    return passes == 0 ? 0 : edge ? -1 : passes;
}

}  // namespace hord::sim
