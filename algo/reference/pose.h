// Pose of a part relative to the reference: a small shift and turn.
//
// A point p of the part's frame, in lenslets from the middle of the field, is at
//     q = R(-turn) (p - shift)
// in the reference. The turn is stored as its sine, the cosine is sqrt(1 - sine^2): IEEE 754 rounds both alike on every
// machine.
#pragma once

#include <cmath>

#include "algo/frame/extents.h"

namespace hord::algo {

// std::floor as an int, without a library call.
constexpr int floor_of(double v) {
    const int towards_zero = static_cast<int>(v);
    return towards_zero - (v < towards_zero ? 1 : 0);
}

struct Pose {
    double x = 0, y = 0;  // shift, lenslets, to the right and down
    double sine = 0;      // of the turn, from x towards y

    [[nodiscard]] double turn_rad() const { return std::asin(sine); }  // for display
};

// The coordinate transform of one pose: lenslets of the part to lenslets of the reference, and back.
class PoseMap {
  public:
    PoseMap(const Pose& pose, const Extents& extents)
        : pose_(pose), cosine_(std::sqrt(1 - pose.sine * pose.sine)), middle_m_(0.5 * (extents.m - 1)),
          middle_n_(0.5 * (extents.n - 1)) {}

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
    // A deflection of the reference, turned with the part.
    [[nodiscard]] Place turned(double x, double y) const {
        return {cosine_ * x - pose_.sine * y, cosine_ * y + pose_.sine * x};
    }

  private:
    Pose pose_;
    double cosine_, middle_m_, middle_n_;
};

// Catmull-Rom weights of four lenslets, for a point `t` (0..1) after the second of them. They reproduce parabolas: a
// HORD that moves linearly from lenslet to lenslet keeps its mean and its spread in between.
struct CubicWeights {
    double of[4];
    static constexpr CubicWeights at(double t) {
        const double t2 = t * t, t3 = t2 * t;
        return {{0.5 * (2 * t2 - t - t3), 0.5 * (3 * t3 - 5 * t2 + 2), 0.5 * (4 * t2 - 3 * t3 + t), 0.5 * (t3 - t2)}};
    }
    static CubicWeights slope_at(double t) {
        const double t2 = t * t;
        return {
            {0.5 * (4 * t - 1 - 3 * t2), 0.5 * (9 * t2 - 10 * t), 0.5 * (8 * t - 9 * t2 + 1), 0.5 * (3 * t2 - 2 * t)}};
    }
    static CubicWeights linear_at(double t) { return {{0, 1 - t, t, 0}}; }
    // Parabolas through three of them: the first three; the last three.
    static CubicWeights before_at(double t) { return {{0.5 * t * (t - 1), (1 - t) * (1 + t), 0.5 * t * (t + 1), 0}}; }
    static CubicWeights after_at(double t) { return {{0, 0.5 * (1 - t) * (2 - t), t * (2 - t), 0.5 * t * (t - 1)}}; }
};

// The lenslets around a point that an interpolation uses, with their weights: 4x4; where some have no value 3x4, 4x3,
// 3x3 or 2x2.
struct InterpolationWindow {
    int m = 0, n = 0;            // of the top-left one of the 4x4
    CubicWeights along, across;  // by m, by n; 0: not used
    bool found = false;

    // `usable(m, n)`: the lenslet has a value; called inside the field only.
    template <class Usable>
    static InterpolationWindow of(double m, double n, const Extents& e, Usable&& usable) {
        const double floor_m = std::floor(m), floor_n = std::floor(n), t = m - floor_m, u = n - floor_n;
        InterpolationWindow s;
        s.m = static_cast<int>(floor_m) - 1, s.n = static_cast<int>(floor_n) - 1;
        if (s.m < -1 || s.n < -1 || s.m + 2 >= e.m || s.n + 2 >= e.n) return s;
        unsigned bad[4];  // of each row; bit c: column c
        for (int r = 0; r < 4; ++r) {
            bad[r] = 0;
            for (int c = 0; c < 4; ++c) {
                const int x = s.m + c, y = s.n + r;
                const bool inside = x >= 0 && y >= 0 && x < e.m && y < e.n;
                if (!inside || !usable(x, y)) bad[r] |= 1U << c;
            }
        }
        constexpr unsigned kAll = 15, kBefore = 7, kAfter = 14, kMiddle = 6;
        constexpr unsigned kTries[][2] = {{kAll, kAll},     {kAll, kBefore},    {kAll, kAfter},    {kBefore, kAll},
                                          {kAfter, kAll},   {kBefore, kBefore}, {kBefore, kAfter}, {kAfter, kBefore},
                                          {kAfter, kAfter}, {kMiddle, kMiddle}};
        for (const auto& [columns, rows] : kTries) {
            unsigned any = 0;
            for (int r = 0; r < 4; ++r) any |= (rows >> r & 1U) != 0 ? bad[r] & columns : 0;
            if (any != 0) continue;
            const auto weights = [](unsigned used, double at) {
                return used == kAll   ? CubicWeights::at(at)
                    : used == kBefore ? CubicWeights::before_at(at)
                    : used == kAfter  ? CubicWeights::after_at(at)
                                      : CubicWeights::linear_at(at);
            };
            s.along = weights(columns, t), s.across = weights(rows, u);
            s.found = true;
            return s;
        }
        return s;
    }
};

}  // namespace hord::algo
