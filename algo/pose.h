// Where a part lies compared with the reference parts: moved and turned a little.
//
// A place of the part's frame, in lenslets from the middle of the field, is at
//     q = R(-turn) (p - shift)
// in the reference. The turn is given by its sine, and the cosine is sqrt(1 - sine^2): operations that are rounded alike everywhere.
#pragma once

#include <cmath>

#include "algo/light_field.h"

namespace hord::algo {

struct Pose {
    double x = 0, y = 0;  // shift, lenslets, to the right and down
    double sine = 0;      // of the turn, from x towards y

    [[nodiscard]] double turn_rad() const { return std::asin(sine); }  // for people
};

// The map of one pose over a field: lenslet of the part -> place in the reference, and back.
class PoseMap {
  public:
    PoseMap(const Pose& pose, const Extents& extents)
        : pose_(pose), cosine_(std::sqrt(1 - pose.sine * pose.sine)), middle_m_(0.5 * (extents.m - 1)), middle_n_(0.5 * (extents.n - 1)) {}

    struct Place {
        double m, n;
    };
    [[nodiscard]] Place to_reference(double m, double n) const {
        const double x = m - middle_m_ - pose_.x, y = n - middle_n_ - pose_.y;
        return {cosine_ * x + pose_.sine * y + middle_m_, cosine_ * y - pose_.sine * x + middle_n_};
    }
    [[nodiscard]] Place to_part(double m, double n) const {
        const double x = m - middle_m_, y = n - middle_n_;
        return {cosine_ * x - pose_.sine * y + middle_m_ + pose_.x, cosine_ * y + pose_.sine * x + middle_n_ + pose_.y};
    }
    // A deflection of the reference as the turned part has it.
    [[nodiscard]] Place turned(double x, double y) const { return {cosine_ * x - pose_.sine * y, cosine_ * y + pose_.sine * x}; }

  private:
    Pose pose_;
    double cosine_, middle_m_, middle_n_;
};

// Catmull-Rom weights of the four lenslets around a place that lies `t` (0..1) after the second of them: they reproduce parabolas, so that
// a HORD that moves evenly from lenslet to lenslet keeps its mean and its spread in between.
struct CubicWeights {
    double of[4];
    static CubicWeights at(double t) {
        const double t2 = t * t, t3 = t2 * t;
        return {{0.5 * (2 * t2 - t - t3), 0.5 * (3 * t3 - 5 * t2 + 2), 0.5 * (4 * t2 - 3 * t3 + t), 0.5 * (t3 - t2)}};
    }
    static CubicWeights slope_at(double t) {
        const double t2 = t * t;
        return {{0.5 * (4 * t - 1 - 3 * t2), 0.5 * (9 * t2 - 10 * t), 0.5 * (8 * t - 9 * t2 + 1), 0.5 * (3 * t2 - 2 * t)}};
    }
    static CubicWeights linear_at(double t) { return {{0, 1 - t, t, 0}}; }
};

}  // namespace hord::algo
