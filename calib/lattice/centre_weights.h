// The radial profile of a frame's lenslets, and the weight that finds their centres: see calib/lattice/centres.h, whose
// source is the only user.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "calib/lattice/centres.h"

namespace hord::calib {

using Table = std::vector<double>;   // of a function of the radius r, one value each kTableStep
constexpr double kTableStep = 0.05;  // px
constexpr double kTaper = 2.0;       // px over which the weight falls to zero at the window's rim

// Linear interpolation; 0 beyond the table.
inline double lookup(const Table& table, double r) {
    const double at = r / kTableStep;
    const auto k = static_cast<std::size_t>(at);
    if (k + 1 >= table.size()) return 0;
    const double part = at - static_cast<double>(k);
    return table[k] + part * (table[k + 1] - table[k]);
}

// T(r), 0..1, and -T'(r) / r.
struct Profile {
    Table value, steepness;
    double floor = 0;  // what was subtracted: background, and neighbours that overlap; of the profile's height
};

// The radial tables of one weight: the shift weight w(r), the profile over its level at the rim, the window, and the
// profile's steepness.
struct Weights {
    double radius = 0;
    Table shift, profile, window, steepness;
    Immunity immunity;
    double floor = 0;      // the light's level at the rim, of the profile's height
    bool plateau = false;  // half way to its half height the profile has nearly its full height
};

// The first index at which a table is at most half of its first value, or its last index.
std::size_t half_height(const Table& profile);

// The profile to begin with: a raised cosine of this radius.
Profile raised_cosine(double radius);

// The mean radial profile about known centres, 1 at its top, by least squares from Gaussian rings. Rings are smooth and
// even in r, so the weight made of them is smooth on the pixel grid wherever the centre lies.
Profile measure_profile(const WhiteImage& image, std::span<const Spot> spots, double reach);

// The most efficient weight for `profile` inside `radius`; with `against` made orthogonal to gradients of the
// background and of the light: `where_cheap` as far as kMaxVariance allows, `always` wherever there is a plateau.
Weights design_weights(const Profile& profile, double radius, std::optional<AgainstGradients> against);

// As CentreFinder::shift_by_gradient_px2(), unlike_by_shift_px2(), edge_variance_px2() and stretch_shown();
// `smoothed_px`: WhiteImage::smoothed_px().
double shift_by_gradient(const Weights& of);
double unlike_by_shift(const Weights& of);
double edge_variance(const Weights& of);
double stretch_shown(const Weights& of, double smoothed_px);

}  // namespace hord::calib
