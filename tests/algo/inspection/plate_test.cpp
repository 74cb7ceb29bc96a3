// Plates (docs/notes/inspection.md): what their edges enclose, and what is missing at their outline.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>

#include <gtest/gtest.h>

#include "tests/algo/inspection/drawn_forms.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

TEST(Plate, is_what_its_edges_enclose_though_they_have_gaps) {
    const Rows whole = {"..............", "..............", "..dddddddddd..", "..d........d..", "..d........d..",
                        "..d........d..", "..d........d..", "..dddddddddd..", "..............", ".............."};
    const Rows expected = {"oooooooooooooo", "oooooooooooooo", "oorrrrrrrrrroo", "oorjjjjjjjjroo", "oorjjjjjjjjroo",
                           "oorjjjjjjjjroo", "oorjjjjjjjjroo", "oorrrrrrrrrroo", "oooooooooooooo", "oooooooooooooo"};
    EXPECT_EQ(marked(whole, PartForm::plate).rows, expected);
    EXPECT_EQ(marked(whole, PartForm::plate).found.parts, 1);
    Rows gaps = whole;
    gaps[4] = gaps[5] = "...........d..";
    gaps[6] = "..........dd..";
    gaps[2] = "..ddd...dddd..";
    gaps[4][6] = 'd';  // a speck on the plate
    const Marked open = marked(gaps, PartForm::plate);
    EXPECT_EQ(open.rows, expected);
    EXPECT_EQ(open.found.parts, 1);
}

// A triangle is missing at a corner: the hull of what is left is convex. A small one is within the outline's error.
TEST(Plate, tells_that_its_outline_lacks_a_corner) {
    const auto without_corner = [](int corner, int left) {
        Rows drawing(24, std::string(28, '.'));
        for (int n = 3; n < 21; ++n) {
            for (int m = left; m < 25; ++m) {
                const bool gone = m - left + n - 3 < corner,
                           at_edge = n == 3 || n == 20 || m == left || m == 24 || m - left + n - 3 == corner;
                if (!gone && at_edge) drawing[static_cast<std::size_t>(n)][static_cast<std::size_t>(m)] = 'd';
            }
        }
        return marked(drawing, PartForm::plate).found;
    };
    EXPECT_FALSE(without_corner(0, 3).lacks_place);
    EXPECT_FALSE(without_corner(2, 3).lacks_place);
    EXPECT_TRUE(without_corner(3, 3).lacks_place);
    EXPECT_TRUE(without_corner(8, 3).lacks_place);
    EXPECT_FALSE(without_corner(2, 0).lacks_place);  // the field cuts it
    EXPECT_TRUE(without_corner(3, 0).lacks_place);   // its left corner is broken all the same
}

TEST(Plate, may_leave_the_field_on_one_or_two_sides) {
    const Rows right = {"..............", "..............", "..dddddddddddd", "..d...........", "..d...........",
                        "..d...........", "..d...........", "..dddddddddddd", "..............", ".............."};
    const Marked one = marked(right, PartForm::plate);
    EXPECT_EQ(one.rows[2], "oorrrrrrrrrrrr");
    for (std::size_t n = 3; n < 7; ++n) EXPECT_EQ(one.rows[n], "oorjjjjjjjjjjr");
    EXPECT_EQ(one.found.at_border, 6U);
    EXPECT_EQ(one.found.cut, 1);
    Rows corner = right;
    corner[7] = corner[8] = corner[9] = corner[3];
    for (const bool upside_down : {false, true}) {
        Rows drawing = corner;
        if (upside_down) std::ranges::reverse(drawing);
        const Marked cut = marked(drawing, PartForm::plate);
        EXPECT_GT(cut.found.cut, 1);
        Rows rows = cut.rows;
        if (upside_down) std::ranges::reverse(rows);
        EXPECT_EQ(rows[1], "oooooooooooooo");
        EXPECT_EQ(rows[2], "oorrrrrrrrrrrr");
        for (std::size_t n = 3; n < 9; ++n) EXPECT_EQ(rows[n], "oorjjjjjjjjjjr");
    }
    const Marked strip = marked({"..............", "..............", "dddddddddddddd", "..............",
                                 "..............", "..............", "dddddddddddddd", ".............."},
                                PartForm::plate);
    EXPECT_EQ(strip.rows[4], "rjjjjjjjjjjjjr");
    EXPECT_EQ(strip.rows[0], "oooooooooooooo");
    EXPECT_EQ(strip.found.cut, 0);
}

// Dirt beside the plate, and a plate of which one edge is seen: it could lie on either side.
TEST(Plate, is_not_found_by_dust_or_by_one_edge) {
    Rows drawing = repeated("..............", 16);
    EXPECT_EQ(marked(drawing, PartForm::plate).found.parts, 0);
    drawing[3][2] = drawing[8][11] = 'd';
    EXPECT_EQ(marked(drawing, PartForm::plate).rows[7], "rjjjjjjjjjjjjr");
    for (std::string& row : drawing) row[6] = 'd';
    const Marked edge = marked(drawing, PartForm::plate);
    EXPECT_EQ(edge.found.parts, 0);
    EXPECT_EQ(edge.rows[7], "rjjjjjjjjjjjjr");
}

// What two faces of glass let through.
constexpr double kGlass = 0.92;

// Of a plate only a piece may be in the field: half a part is not known to be good. One that reaches from border to
// border, as wide on both sides, is longer than the field. A corner that the border takes off is less than the margin.
TEST(Plate, that_the_field_cuts_is_unfit_unless_the_recipe_allows_any_outline) {
    struct Place {
        const char* what;
        double m, n, half_m, half_n, turn;  // lenslets, rad
        bool is_cut;
    };
    constexpr double kFar = 100, kDiagonal = 0.7854;
    const Place places[] = {{"inside", 30, 30, 15, 12, 0, false},
                            {"a third", 66, 30, 16, 12, 0, true},
                            {"two thirds", -2, 30, 16, 12, 0, true},
                            {"narrow, an end beyond", 44, 30, 40, 8, 0, true},
                            {"a corner", 58, 58, 20, 20, 0, true},
                            {"a corner that points inwards", 30, 75, 30, 30, kDiagonal, true},
                            {"from border to border", 30, 30, kFar, 10, 0, false},
                            {"from border to border, askew", 30, 30, kFar, 10, 0.2, false},
                            {"from border to border, more askew", 30, 30, kFar, 7, 0.14, false},
                            {"from border to border, down", 25, 30, 11, kFar, 0, false},
                            {"from border to border, turned", 30, 30, kFar, 10, 0.5, false},
                            {"from corner to corner of the field", 28, 30, kFar, 10, kDiagonal, false},
                            {"across a corner of the field", 48, 12, kFar, 9, kDiagonal, false},
                            {"corners that touch two borders", 23, 23, 17, 17, kDiagonal, false},
                            {"corners that touch all borders", 30, 30, 22, 22, kDiagonal, false},
                            {"less a tip", 30, 44, 14, 14, kDiagonal, false}};
    const Extents e{61, 61, 9, 9};
    for (const Place& p : places) {
        const Frame frame =
            noisy(drawn(e, 8, 240,
                        [&](int m, int n) {
                            const double x = m - p.m, y = n - p.n, u = x * std::cos(p.turn) + y * std::sin(p.turn),
                                         v = y * std::cos(p.turn) - x * std::sin(p.turn),
                                         depth = std::min(p.half_m - std::abs(u), p.half_n - std::abs(v));
                            return Spot{0, 0, depth < -1 ? 1 : depth < 0 ? 0.6 : depth < 1.5 ? 0 : kGlass};
                        }),
                  {10, 2, 1}, 3);
        Recipe plate;
        plate.form = PartForm::plate;
        auto pipeline = Pipeline::create(e, 8, plate);
        ASSERT_TRUE(pipeline);
        const auto seen = pipeline->inspect(frame.view());
        ASSERT_TRUE(seen);
        EXPECT_EQ(seen->verdict, p.is_cut ? Verdict::unfit : Verdict::pass) << p.what;
        EXPECT_EQ(seen->frame.fault, p.is_cut ? FrameFault::cut_by_field : FrameFault::none) << p.what;
        plate.symmetric_outline = false;
        EXPECT_EQ(verdict_on(frame, e, plate), Verdict::pass) << p.what;
    }
}

// Of a strip from border to border a corner is broken off: the break is an edge that no rectangle has there. A strip of
// which both edges are seen whole is good, however it lies; so is a round plate that touches the border.
TEST(Plate, a_strip_with_a_corner_broken_off_inside_the_field_is_unfit) {
    const Extents e{61, 61, 9, 9};
    const auto judged = [&](auto&& depth_at) {
        const Frame frame =
            noisy(drawn(e, 8, 240,
                        [&](int m, int n) {
                            const double depth = depth_at(m, n);
                            return Spot{0, 0, depth < -1 ? 1 : depth < 0 ? 0.6 : depth < 1.5 ? 0 : kGlass};
                        }),
                  {10, 2, 1}, 3);
        Recipe plate;
        plate.form = PartForm::plate;
        auto pipeline = Pipeline::create(e, 8, plate);
        EXPECT_TRUE(pipeline);
        const auto seen = pipeline->inspect(frame.view());
        EXPECT_TRUE(seen);
        return seen->frame.fault;
    };
    for (const double half_width : {8.0, 15.0, 24.0}) {
        for (const double turn : {0.0, 0.1, 0.5}) {
            if (half_width > 20 && turn > 0) continue;   // an edge would lie outside
            for (const double leg : {0.0, 9.0, 14.0}) {  // of the triangle that is missing
                const auto depth = [&](int m, int n) {
                    const double x = m - 30, y = n - 30, u = x * std::cos(turn) + y * std::sin(turn),
                                 v = y * std::cos(turn) - x * std::sin(turn), edge = half_width - std::abs(v),
                                 end = (30 - std::abs(half_width * std::sin(turn))) / std::cos(turn);  // of the edge
                    return leg > 0 ? std::min(edge, ((end - u) + (half_width - v) - leg) / std::sqrt(2.0)) : edge;
                };
                const FrameFault found = judged(depth);
                if (leg > 0) EXPECT_TRUE(found == FrameFault::lopsided || found == FrameFault::cut_by_field);
                else EXPECT_EQ(found, FrameFault::none);
                if (HasFailure()) FAIL() << half_width << ", " << turn << ", " << leg;
            }
        }
    }
    EXPECT_EQ(judged([](int m, int n) { return 20 - std::hypot(m - 41, n - 30); }), FrameFault::none);
}

// Verdicts: a corner that is missing, unless the recipe allows any outline; spots that are wider than beside the plate.
TEST(Plate, without_a_corner_or_with_wide_spots_all_over_is_unfit) {
    const Extents e{50, 44, 9, 9};
    const auto plate = [&](int corner, double wider) {
        Frame frame = drawn(e, 8, 220, [&](int m, int n) -> Spot {
            const int left = m - 9, top = n - 9, right = 40 - m, bottom = 34 - n;
            const int inside = std::min(std::min({left, right, top, bottom}), left + top - corner);
            return {0, 0, inside < 0 ? 1 : inside == 0 ? 0.05 : wider > 0 ? 0.3 : 0.92};
        });
        if (wider > 0) {  // as much light again, one and two bins to the left and to the right
            for (int n = 12; n < 32; ++n) {
                for (int m = 12; m < 38; ++m) {
                    for (int j = 3; j < 6; ++j) {
                        for (const int i : {2, 3, 5, 6}) {
                            const int x = m * 9 + i, y = n * 9 + j;
                            frame.set(x, y, frame.view().sample(x, y) + (j == 4 ? 25U : 3U));
                        }
                    }
                }
            }
        }
        return noisy(frame, {10, 2, 1}, 5);
    };
    Recipe recipe;
    recipe.form = PartForm::plate;
    const auto fault_of = [&](const Frame& frame) {
        auto pipeline = Pipeline::create(e, 8, recipe);
        const auto found = pipeline->inspect(frame.view());
        EXPECT_EQ(found->verdict == Verdict::unfit, found->frame.fault != FrameFault::none);
        return found->frame.fault;
    };
    EXPECT_EQ(verdict_on(plate(0, 0), e, recipe), Verdict::pass);
    EXPECT_EQ(fault_of(plate(12, 0)), FrameFault::lopsided);
    EXPECT_EQ(fault_of(plate(0, 1)), FrameFault::wide_inside);
    recipe.symmetric_outline = false;
    EXPECT_EQ(verdict_on(plate(12, 0), e, recipe), Verdict::pass);
    EXPECT_EQ(fault_of(plate(0, 1)), FrameFault::wide_inside);
}

}  // namespace
}  // namespace hord::algo
