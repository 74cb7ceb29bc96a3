// Pieces that are missing at the outline of a plate or a round part: notches, corners, chords, bites.
#include <algorithm>
#include <cmath>
#include <functional>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{61, 61, 9, 9};
constexpr double kGlass = 0.92;

using Depth = std::function<double(double m, double n)>;  // lenslets into the part

struct Judged {
    FrameFault fault;
    Reason reason;
};
Judged both_of(const Frame& frame, PartForm form, bool known_outline = true) {
    Recipe recipe;
    recipe.form = form;
    recipe.symmetric_outline = known_outline;
    auto pipeline = Pipeline::create(kField, 8, recipe);
    EXPECT_TRUE(pipeline);
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    EXPECT_EQ(seen->verdict == Verdict::pass, seen->frame.fault == FrameFault::none && seen->defects.empty());
    return {seen->frame.fault, seen->reason};
}
FrameFault judged(const Frame& frame, PartForm form, bool known_outline = true) {
    return both_of(frame, form, known_outline).fault;
}

// Glass whose edge is dark over 1.5 lenslets, but where `is_open`: a break is as clear as the field.
Frame plate(const Depth& depth, const std::function<bool(double, double)>& is_open = {}, double light = 240,
            std::uint64_t seed = 3) {
    return noisy(drawn(kField, 8, light,
                       [&](int m, int n) {
                           const double d = depth(m, n);
                           const bool open = is_open && is_open(m, n);
                           return Spot{0, 0, open || d < -1 ? 1 : d < 0 ? 0.6 : d < 1.5 ? 0 : kGlass};
                       }),
                 {10, 2, 1}, seed);
}

struct Turned {
    double u, v;
};
Turned turned(double m, double n, double by) {
    const double x = m - 30, y = n - 30;
    return {x * std::cos(by) + y * std::sin(by), y * std::cos(by) - x * std::sin(by)};
}

// Legs of the cuts at two corners opposite each other, and at the two others.
Depth rectangle(double turn, double first_leg, double third_leg, double others) {
    return [=](double m, double n) {
        const auto [u, v] = turned(m, n, turn);
        const auto cut = [](double from_u, double from_v, double leg) {
            return (from_u + from_v - leg) / std::sqrt(2);
        };
        const double a = 20, b = 15;
        return std::min({a - std::abs(u), b - std::abs(v), cut(a - u, b - v, first_leg), cut(a + u, b + v, third_leg),
                         cut(a + u, b - v, others), cut(a - u, b + v, others)});
    };
}

TEST(MissingPieces, are_corners_that_are_not_cut_as_the_others_are) {
    for (const double turn : {0.0, 0.03, 0.4, 0.7}) {
        for (const double all : {0.0, 3.0, 6.0})
            EXPECT_EQ(judged(plate(rectangle(turn, all, all, all)), PartForm::plate), FrameFault::none) << turn << all;
        for (const double leg : {5.0, 6.0, 8.0, 12.0}) {
            EXPECT_EQ(judged(plate(rectangle(turn, leg, 0, 0)), PartForm::plate), FrameFault::lopsided) << turn << leg;
            EXPECT_EQ(judged(plate(rectangle(turn, leg, leg, 0)), PartForm::plate), FrameFault::lopsided)
                << turn << leg;
        }
        EXPECT_EQ(judged(plate(rectangle(turn, 6, 6, 0)), PartForm::plate, false), FrameFault::none) << turn;
    }
}

TEST(MissingPieces, are_no_corners_of_a_parallelogram_or_a_hexagon) {
    for (const double turn : {0.0, 0.03, 0.4, 0.7}) {
        const auto parallelogram = [=](double m, double n) {
            const auto [u, v] = turned(m, n, turn);
            return std::min((18 - std::abs(u - 0.4 * v)) / std::hypot(1, 0.4), 14 - std::abs(v));
        };
        const auto hexagon = [=](double m, double n) {
            const auto [u, v] = turned(m, n, turn);
            const double half = std::sqrt(0.75) * std::abs(u);
            return 17 - std::max({std::abs(v), half + v / 2, half - v / 2});
        };
        EXPECT_EQ(judged(plate(parallelogram), PartForm::plate), FrameFault::none) << turn;
        EXPECT_EQ(judged(plate(hexagon), PartForm::plate), FrameFault::none) << turn;
    }
}

TEST(MissingPieces, are_notches_in_an_edge_whose_walls_are_not_seen) {
    int notched = 0;
    for (const double turn : {0.0, 0.03, 0.5}) {
        for (const double wide : {4.0, 6.0, 10.0}) {
            for (const double deep : {3.0, 4.0, 6.0}) {
                const auto notch = [=](double m, double n) {
                    const auto [u, v] = turned(m, n, turn);
                    return std::abs(u - 4) < wide / 2 && v > 15 - deep;
                };
                const Frame frame = plate(rectangle(turn, 0, 0, 0), notch);
                const auto [fault, reason] = both_of(frame, PartForm::plate);
                notched += fault == FrameFault::notched ? 1 : 0;
                // One that reaches into what is judged is a defect.
                EXPECT_TRUE(fault == FrameFault::notched || reason == Reason::missing_material)
                    << turn << ", " << wide << ", " << deep << ": " << name_of(reason);
            }
        }
    }
    EXPECT_GE(notched, 9);
}

// A side has few lines to tell its noise by; all four have enough.
TEST(MissingPieces, are_notches_in_little_light_too) {
    const auto notch = [](double m, double n) { return std::abs(m - 30) < 3 && n < 22; };
    int missed = 0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        const Frame frame = plate(rectangle(0.2, 0, 0, 0), notch, 60, seed);
        const auto [fault, reason] = both_of(frame, PartForm::plate);
        missed += fault == FrameFault::none && reason == Reason::none ? 1 : 0;
    }
    EXPECT_EQ(missed, 0);
}

// The field cuts both ends; pieces are missing opposite each other, so that the outline is the same turned.
TEST(MissingPieces, are_those_opposite_each_other_of_a_strip) {
    for (const double leg : {0.0, 5.0, 9.0}) {
        const auto strip = [=](double m, double n) {
            const double u = m - 30, v = n - 30;
            const auto cut = [&](double x, double y) { return (x + y - leg) / std::sqrt(2); };
            const double edge = 10 - std::abs(v);
            return leg > 0 ? std::min({edge, cut(30 - u, 10 - v), cut(30 + u, 10 + v)}) : edge;
        };
        EXPECT_EQ(judged(plate(strip), PartForm::plate), leg > 0 ? FrameFault::lopsided : FrameFault::none) << leg;
    }
}

TEST(MissingPieces, are_chords_and_bites_of_discs_and_lenses) {
    const auto disc = [](double chord, double bite) {
        return [=](double m, double n) {
            const double x = m - 29, y = n - 31, r = std::hypot(x, y);
            return std::min({20 - r, 20 - chord - (x * 0.8 + y * 0.6), std::hypot(x - 16, y - 12) - bite});
        };
    };
    for (const auto& [chord, bite] :
         {std::pair(0.0, 0.0), std::pair(4.0, 0.0), std::pair(6.0, 0.0), std::pair(0.0, 4.0)}) {
        const FrameFault expected = chord + bite > 0 ? FrameFault::lopsided : FrameFault::none;
        if (bite == 0) {
            EXPECT_EQ(judged(plate(disc(chord, bite)), PartForm::plate), expected) << chord;
        }
        const Depth depth = disc(chord, bite);
        const Frame lens = noisy(drawn(kField, 8, 240,
                                       [&](int m, int n) {
                                           const bool inside = depth(m, n) > 0;
                                           const double bins = 0.12;
                                           return inside ? Spot{bins * (m - 29), bins * (n - 31), 0.95} : Spot{};
                                       }),
                                 {10, 2, 1}, 3);
        EXPECT_EQ(judged(lens, PartForm::round), expected) << chord << ", " << bite;
    }
}

}  // namespace
}  // namespace hord::algo
