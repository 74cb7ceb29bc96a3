// How the form of good parts varies: smooth changes of the mean deflection over the whole part, as tolerances of tilt,
// wedge, centring, curvature and index make them. A part's amounts are found together with its pose
// (algo/reference/registration.h) and do not count as deviations.
//
// Seven modes, each with an amount in bin pitches but the last one: a constant, and slopes along x and along y, of the
// deflection along x and along y; and the share by which the reference's own deflections are larger. They are smooth:
// a local flaw is none of them. Why these: docs/adr/0016-form.md.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "algo/frame/extents.h"

namespace hord::algo {

constexpr std::size_t kFormModes = 7;

struct Form {
    struct Change {
        double x = 0, y = 0;  // of the mean deflection, bin pitches
    };
    std::array<double, kFormModes> amounts{};

    // The modes at (x, y) from the middle of the field, in its half widths, where the reference deflects light by
    // (x_bins, y_bins): mode k changes the deflection along x by along_x[k].
    struct Modes {
        std::array<double, kFormModes> along_x, along_y;
    };
    static constexpr Modes modes_at(double x, double y, double x_bins, double y_bins) {
        return {{1, x, y, 0, 0, 0, x_bins}, {0, 0, 0, 1, x, y, y_bins}};
    }
    [[nodiscard]] constexpr Change at(double x, double y, double x_bins, double y_bins) const {
        return {amounts[0] + amounts[1] * x + amounts[2] * y + amounts[6] * x_bins,
                amounts[3] + amounts[4] * x + amounts[5] * y + amounts[6] * y_bins};
    }
};

// The half width of the field, lenslets: the unit of (x, y) in modes_at().
constexpr double half_field(const Extents& e) { return 0.5 * (std::max(e.m, e.n) - 1); }

constexpr double kMaxFormResponse = 2;

// Variances of the amounts among good parts; 0: the mode does not vary.
using FormVariances = std::array<float, kFormModes>;

}  // namespace hord::algo
