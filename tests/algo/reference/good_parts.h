// Drawn parts of one kind, a reference learned from them, and a judgement against it.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "tests/support/frames.h"

namespace hord::algo::testing {

inline constexpr Extents kField{41, 37, 9, 9};
inline constexpr int kBits = 12;
inline constexpr double kElectrons = 2000;  // a lenslet
inline constexpr float kReadDn = 2;
inline const LightLevels kLevels{6, 60, 4095};
inline constexpr double kHalfM = 15, kHalfN = 12;  // of the elliptic part, lenslets

// A part in free light that deflects light more along x than along y, so that it is not round. One electron a DN.
inline Frame part(
    const Pose& pose, const std::function<void(int, int, Spot&)>& defect = [](int, int, Spot&) {}) {
    const PoseMap map(pose, kField);
    const double full_bin = kElectrons / (1.22 * 1.22);
    const auto inside = [&](int m, int n) {  // covered share of the lenslet, from 7x7 points
        double share = 0;
        for (int k = 0; k < 49; ++k) {
            const auto q = map.to_reference(m + (k % 7 - 3) / 7.0, n + (k / 7 - 3) / 7.0);
            share += std::hypot((q.m - 0.5 * (kField.m - 1)) / kHalfM, (q.n - 0.5 * (kField.n - 1)) / kHalfN) < 1
                ? 1.0 / 49
                : 0;
        }
        return share;
    };
    Frame frame = drawn(kField, kBits, full_bin, [&](int m, int n) {
        const auto q = map.to_reference(m, n);
        const auto deflection_shift =
            map.turned(0.15 * (q.m - 0.5 * (kField.m - 1)), 0.08 * (q.n - 0.5 * (kField.n - 1)));
        Spot spot{deflection_shift.m, deflection_shift.n, 0.9};
        defect(m, n, spot);
        spot.light *= inside(m, n);
        return spot;
    });
    const Frame beside = drawn(kField, kBits, full_bin, [&](int m, int n) { return Spot{0, 0, 1 - inside(m, n)}; });
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x)
            frame.set(x, y, frame.view().sample(x, y) + beside.view().sample(x, y));
    }
    return frame;
}
inline Frame seen(const Frame& frame, std::uint64_t seed, double light = 1) {
    return noisy(frame, {1, 2, light}, seed, kBits);
}

inline constexpr Extents kPlateField{61, 61, 9, 9};

// A plate in free light, 30x23 lenslets with dark bevels of three lenslets, behind which the light is tilted by so many
// bins. `opaque(x, y)`: no light passes there, lenslets from the middle. One electron a DN.
inline Frame plate_with_dark_bevels(
    const Pose& pose, double x_bins, double y_bins,
    const std::function<bool(double, double)>& opaque = [](double, double) { return false; }) {
    const PoseMap map(pose, kPlateField);
    // The share of a lenslet that is free or behind the plate's inside, from 11x11 points.
    const auto clear = [&](int m, int n, bool inside) {
        int points = 0;
        for (int t = 0; t < 121; ++t) {
            const auto q = map.to_reference(m + (t % 11 - 5) / 11.0, n + (t / 11 - 5) / 11.0);
            const double x = std::abs(q.m - 30), y = std::abs(q.n - 30);
            points += (inside ? x < 12 && y < 8.5 && !opaque(q.m - 30, q.n - 30) : x > 15 || y > 11.5) ? 1 : 0;
        }
        return points / 121.0;
    };
    const double full_bin = kElectrons / (1.22 * 1.22);
    Frame frame = drawn(kPlateField, kBits, full_bin, [&](int m, int n) {
        return Spot{x_bins, y_bins, clear(m, n, true)};
    });
    const Frame beside = drawn(kPlateField, kBits, full_bin, [&](int m, int n) {
        return Spot{0, 0, clear(m, n, false)};
    });
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x)
            frame.set(x, y, frame.view().sample(x, y) + beside.view().sample(x, y));
    }
    return frame;
}
inline Result<Learned> learn_plates(const std::vector<Frame>& frames) {
    LearnOptions options;
    options.levels = kLevels;
    options.electrons_per_dn = 1;
    options.read_dn = kReadDn;
    return learn_reference(
        kPlateField, kBits, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
}

inline Pose wobble(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> shift(-0.5, 0.5), turn(-0.0175, 0.0175);
    const double x = shift(random), y = shift(random);
    return {x, y, std::sin(turn(random))};
}

inline Result<Learned> learn(std::size_t count, const std::function<Frame(std::size_t)>& frame,
                             std::optional<float> gain = 1.0F) {
    LearnOptions options;
    options.levels = kLevels;
    options.electrons_per_dn = gain;
    options.read_dn = kReadDn;
    return learn_reference(
        kField, kBits, count, [&](std::size_t k) -> Result<Frame> { return frame(k); }, options);
}

// Learned from sixteen parts with slightly different poses.
inline const Learned& learned() {
    static const Learned all = [] {
        std::vector<Frame> frames;
        for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(seen(part(wobble(k)), k));
        return learn(frames.size(), [&](std::size_t k) { return frames[k]; }).value();
    }();
    return all;
}

inline Recipe recipe() {
    Recipe r;
    r.dark_dn = kLevels.dark, r.min_sum_dn = kLevels.min_sum, r.saturated_dn = kLevels.saturated;
    r.reference = std::make_shared<Reference>(learned().reference);
    return r;
}
struct Judged {
    Verdict verdict;
    Reason reason;
    std::vector<Defect> defects;
    std::vector<float> z_score;
    Registered registered;
};
inline Judged judge(const Frame& frame, const Recipe& with = recipe(), int threads = 1) {
    auto pipeline = Pipeline::create(with.reference->extents, kBits, with, threads);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    const auto found = pipeline->inspect(frame.view());
    EXPECT_TRUE(found);
    return {found->verdict,
            found->reason,
            {found->defects.begin(), found->defects.end()},
            {found->z_score.begin(), found->z_score.end()},
            found->registered};
}

}  // namespace hord::algo::testing
