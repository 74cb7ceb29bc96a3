// Plates in free light: clear or tinted glass, with bevels that are dark or bend light, or without.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "tests/support/frames.h"

namespace hord::algo::testing {

inline constexpr Extents kPlates{61, 61, 9, 9};
inline constexpr int kPlateBits = 12;
inline constexpr double kPlateElectrons = 2000;                // a lenslet of free light, in full light
inline constexpr double kPlateHalfM = 15, kPlateHalfN = 11.5;  // lenslets

struct PlateKind {
    double light = 0.92;  // that the glass lets through
    double bevel = 0;     // lenslets
    double bend = 0;      // bins, outwards; 0: the bevel is dark
};
inline constexpr PlateKind kClearPlate{}, kTintedPlate{0.6}, kDarkBevels{0.92, 1.5}, kBentBevels{0.92, 1.5, 2.5};

struct PlateShot {
    Pose pose;
    double tilt_x = 0, tilt_y = 0;  // of the light behind the glass, bins
    double light = 1;
    // Free light within `radius` lenslets of this place, lenslets from the plate's middle: a hole, or a chip.
    double hole_x = 0, hole_y = 0, radius = 0;
    std::vector<std::pair<double, double>> places{{0, 0}};  // lenslets: the mean of exposures there
};

class PlateCamera {
  public:
    explicit PlateCamera(std::uint64_t seed, double electrons_per_dn = 1)
        : electrons_per_dn_(electrons_per_dn), random_(seed) {}

    // Within half a lenslet, a degree and a tenth of a bin.
    PlateShot good() {
        PlateShot shot;
        const double x = 0.5 * uniform(), y = 0.5 * uniform();
        shot.pose = {x, y, std::sin(std::numbers::pi / 180 * uniform())};
        shot.tilt_x = 0.1 * uniform(), shot.tilt_y = 0.1 * uniform();
        return shot;
    }
    double uniform() { return std::uniform_real_distribution<double>(-1, 1)(random_); }

    // With photon and read noise, and 0.5 % of ripple from lenslet to lenslet.
    Frame expose(const PlateKind& kind, const PlateShot& shot) {
        Frame frame(kPlates.width_px(), kPlates.height_px(), kPlateBits);
        const PoseMap map(shot.pose, kPlates);
        for (int n = 0; n < kPlates.n; ++n) {
            for (int m = 0; m < kPlates.m; ++m) {
                Bins bins{};
                const Shares shares = shares_of(kind, shot, map, m, n);
                add(bins, 0, 0, shares[kFree]);
                add(bins, shot.tilt_x, shot.tilt_y, kind.light * shares[kGlass]);
                add(bins, kind.bend, 0, kind.light * shares[kRight]);
                add(bins, -kind.bend, 0, kind.light * shares[kLeft]);
                add(bins, 0, kind.bend, kind.light * shares[kBelow]);
                add(bins, 0, -kind.bend, kind.light * shares[kAbove]);
                const double electrons = kPlateElectrons * shot.light * (1 + 0.005 * normal_(random_));
                for (int b = 0; b < kPlates.bins(); ++b) {
                    const double mean = electrons * bins[static_cast<std::size_t>(b)],
                                 seen = std::max(0.0, mean + std::sqrt(mean) * normal_(random_)),
                                 dn = seen / electrons_per_dn_ + 2 * normal_(random_);
                    frame.set(m * kPlates.i + b % kPlates.i, n * kPlates.j + b / kPlates.i,
                              static_cast<std::uint32_t>(std::clamp(std::lround(dn), 0L, 4095L)));
                }
            }
        }
        return frame;
    }

    // Against `count` good plates in so much light.
    Recipe learn(const PlateKind& kind, std::size_t count = 20, double light = 1) {
        std::vector<Frame> frames;
        for (std::size_t k = 0; k < count; ++k) {
            PlateShot shot = good();
            shot.light = light;
            frames.push_back(expose(kind, shot));
        }
        LearnOptions options;
        options.levels = {6, 60, 4095};
        options.electrons_per_dn = electrons_per_dn_;
        options.read_dn = 2;
        auto learned = learn_reference(
            kPlates, kPlateBits, count, [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
        EXPECT_TRUE(learned) << learned.error().message();
        Recipe recipe;
        recipe.dark_dn = 6, recipe.min_sum_dn = 60, recipe.saturated_dn = 4095;
        if (learned) recipe.reference = std::make_shared<Reference>(std::move(learned->reference));
        return recipe;
    }

  private:
    enum Region : std::uint8_t { kFree, kGlass, kDark, kRight, kLeft, kBelow, kAbove, kRegions };
    using Shares = std::array<double, kRegions>;
    using Bins = std::array<double, static_cast<std::size_t>(9) * 9>;

    static Region region_of(const PlateKind& kind, const PlateShot& shot, double x, double y) {
        const double to_x = kPlateHalfM - std::abs(x), to_y = kPlateHalfN - std::abs(y), into = std::min(to_x, to_y);
        if (into < 0 || std::hypot(x - shot.hole_x, y - shot.hole_y) < shot.radius) return kFree;
        if (into > kind.bevel) return kGlass;
        if (kind.bend == 0) return kDark;
        if (to_x < to_y) return x > 0 ? kRight : kLeft;
        return y > 0 ? kBelow : kAbove;
    }
    static Shares shares_of(const PlateKind& kind, const PlateShot& shot, const PoseMap& map, int m, int n) {
        constexpr int kPoints = 9;  // a side of a lenslet
        Shares shares{};
        for (const auto& [right, down] : shot.places) {
            for (int t = 0; t < kPoints * kPoints; ++t) {
                const auto at = map.to_reference(m - right + (t % kPoints - kPoints / 2) / double{kPoints},
                                                 n - down + (t / kPoints - kPoints / 2) / double{kPoints});
                shares[region_of(kind, shot, at.m - 30, at.n - 30)] +=
                    1.0 / (kPoints * kPoints * static_cast<double>(shot.places.size()));
            }
        }
        return shares;
    }
    // An evenly lit square spot 1.22 bins wide.
    static void add(Bins& bins, double x, double y, double light) {
        constexpr double kHalf = 0.61;
        const auto covered = [](int bin, double at) {
            return std::max(0.0, std::min(bin + 0.5, 4 + at + kHalf) - std::max(bin - 0.5, 4 + at - kHalf)) /
                (2 * kHalf);
        };
        for (int b = 0; light > 0 && b < kPlates.bins(); ++b)
            bins[static_cast<std::size_t>(b)] += light * covered(b % 9, x) * covered(b / 9, y);
    }

    double electrons_per_dn_;
    std::mt19937_64 random_;
    std::normal_distribution<double> normal_;
};

}  // namespace hord::algo::testing
