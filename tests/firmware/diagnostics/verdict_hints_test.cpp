// What a reject may be beside a defect of the part.
#include <algorithm>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "tests/firmware/diagnostics/told.h"

namespace hord::firmware {
namespace {

// A shift of all light against the reference, as moved optics make, looks like a surface all over the part.
TEST(VerdictHints, of_a_surface_says_where_the_light_beside_the_part_moved_too) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    const std::vector<algo::Defect> surface{{.kind = algo::DefectKind::surface}},
        absorbing{{.kind = algo::DefectKind::absorbing}};
    found.defects = surface;
    found.frame.in_free_light = true;
    found.frame.x_bins = 0.03F, found.frame.y_bins = -0.04F;
    found.registered.outcome = algo::Registered::Outcome::found;
    EXPECT_THAT(told(found),
                ::testing::HasSubstr("The free light beside the part moved by 0.05 bins, too: see whether the "
                                     "optics moved"));
    const auto silent = [](const algo::Inspection& i) {
        EXPECT_THAT(told(i), ::testing::Not(::testing::HasSubstr("moved")));
    };
    algo::Inspection other = found;
    other.defects = absorbing;
    silent(other);
    other = found, other.frame.x_bins = 0.014F, other.frame.y_bins = 0;
    silent(other);
    other = found, other.frame.in_free_light = false;
    silent(other);
    other = found, other.registered = {};
    silent(other);
}

TEST(VerdictHints, of_a_lone_sample_says_that_the_pixel_may_be_warm) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    found.score = 2.5F;
    const std::vector<algo::Defect> defects{{.m = 25, .n = 5, .area = 4, .peak = 1}};
    found.defects = defects;
    found.lone_sample = {230, 47, 117};
    EXPECT_THAT(
        told(found),
        ::testing::EndsWith(" 2.5 times its limit. Sample (230, 47) of the macro-pixels alone reads 117 DN more "
                            "than all around it: if it does in every frame, a pixel of the sensor is warm "
                            "there; have the camera correct it, or cool the sensor."));
    // In little light a lenslet's own spot may be one sample.
    found.frame.lost_share = 0.26F;
    EXPECT_THAT(explain(found, recipe(false), kField), ::testing::Not(::testing::HasSubstr("warm")));
    EXPECT_THAT(explain(found, recipe(false), kField), ::testing::HasSubstr("takes 26 % of the light: raise"));
}

TEST(VerdictHints, of_two_lines_of_one_length_names_the_form_of_a_tube) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    found.reason = Reason::absorption;
    const auto tells_tube = [&](float first, float second, algo::DefectKind kind, algo::PartForm form) {
        const std::vector<algo::Defect> defects{
            {.area = 90, .kind = algo::DefectKind::scratch, .length = first, .width = 3},
            {.area = 90, .kind = kind, .length = second, .width = 3}};
        found.defects = defects;
        algo::Recipe alone = recipe(false);
        alone.form = form;
        return explain(found, alone, kField).find("form = \"tube\"") != std::string::npos;
    };
    using algo::DefectKind;
    EXPECT_TRUE(tells_tube(20, 19, DefectKind::scratch, algo::PartForm::round));
    EXPECT_FALSE(tells_tube(20, 19, DefectKind::scratch, algo::PartForm::tube));
    EXPECT_FALSE(tells_tube(20, 19, DefectKind::absorbing, algo::PartForm::round));
    EXPECT_FALSE(tells_tube(20, 12, DefectKind::scratch, algo::PartForm::round));
    EXPECT_FALSE(tells_tube(9, 9, DefectKind::scratch, algo::PartForm::round));
}

// Without a reference a line along the tube may be the slope of what the tube holds: it is called no scratch.
TEST(VerdictHints, of_a_line_along_a_tube_names_its_own_slope) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    const auto names_slope = [&](Reason reason, float length, algo::PartForm form) {
        const std::vector<algo::Defect> defects{
            {.area = 90, .kind = algo::DefectKind::scratch, .length = length, .width = 3}};
        found.defects = defects;
        found.reason = reason;
        algo::Recipe alone = recipe(false);
        alone.form = form;
        const std::string text = explain(found, alone, kField);
        const bool told = text.find("slope of the tube and what is in it") != std::string::npos;
        EXPECT_NE(told, text.find("scratch") != std::string::npos) << text;
        EXPECT_EQ(told, text.find("learn a reference (hordctl learn)") != std::string::npos) << text;
        return told;
    };
    const auto half = static_cast<float>(std::min(kField.m, kField.n)) / 2;
    EXPECT_TRUE(names_slope(Reason::deflection_gradient, half, algo::PartForm::tube));
    EXPECT_TRUE(names_slope(Reason::neighbours_disagree, half, algo::PartForm::tube));
    EXPECT_FALSE(names_slope(Reason::absorption, half, algo::PartForm::tube));
    EXPECT_FALSE(names_slope(Reason::deflection_gradient, half - 1, algo::PartForm::tube));
    EXPECT_FALSE(names_slope(Reason::deflection_gradient, half, algo::PartForm::round));
}

TEST(VerdictHints, of_a_reject_in_little_light_names_the_light) {
    algo::Inspection found;
    const algo::Defect defect{.m = 20, .n = 35, .area = 9};
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::absorption;
    found.defects = {&defect, 1};
    found.dark_dn = 3;
    found.frame.lost_share = 0.19F;
    EXPECT_THAT(explain(found, {}, kField), ::testing::Not(::testing::HasSubstr("dark level")));
    found.frame.lost_share = 0.21F;
    EXPECT_THAT(explain(found, {}, kField),
                ::testing::EndsWith(" The dark level, 3 DN, takes 21 % of the light: raise the light's current, the "
                                    "exposure or the gain before the part is judged."));
}

// A camera that sends 10 bits where 12 were said is as dark as a weak lamp.
TEST(VerdictHints, of_a_dim_frame_whose_samples_look_like_fewer_bits_says_so) {
    constexpr const char* kHint =
        " No sample exceeds 1023, as if they had 10 bits: see what the camera sends, and set "
        "sensor.bits (or --bits) to it.";
    algo::Inspection found = unfit(Reason::too_dark);
    EXPECT_THAT(told(found), ::testing::Not(::testing::HasSubstr("bits")));
    found.frame.fewer_bits = 10;
    EXPECT_THAT(told(found), ::testing::EndsWith(kHint));
    const algo::Defect defect{.m = 20, .n = 35, .area = 9};
    found.verdict = Verdict::reject;
    found.reason = Reason::absorption;
    found.defects = {&defect, 1};
    found.frame.lost_share = 0.21F;
    EXPECT_THAT(explain(found, recipe(false), kField), ::testing::EndsWith(kHint));
}

TEST(VerdictHints, of_a_steep_part_and_of_a_line_at_a_plates_edge_says_what_else_it_may_be) {
    algo::Inspection found;
    algo::Defect defect{.m = 5, .n = 5, .area = 100, .length = 12, .width = 11};
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::deflection_gradient;
    found.defects = {&defect, 1};
    found.lenslets.judged = 801;
    algo::Recipe recipe;
    const algo::Extents extents{12, 12, 9, 9};
    const auto says = [&](const char* text) { return explain(found, recipe, extents).find(text) != std::string::npos; };
    EXPECT_FALSE(says("the slope of the part itself"));
    found.lenslets.judged = 800;
    EXPECT_TRUE(says("the slope of the part itself"));
    recipe.form = algo::PartForm::plate;
    defect.kind = algo::DefectKind::scratch;
    std::vector<std::uint8_t> mask(extents.lenslets());
    found.mask = mask;
    for (const auto& [reason, text] : {std::pair(Reason::deflection_gradient, "a bevel that bends light"),
                                       std::pair(Reason::absorption, "the plate's bevel")}) {
        found.reason = reason;
        mask[extents.index(1, 5)] = 0;
        EXPECT_FALSE(says(text));
        mask[extents.index(2, 8)] = algo::kRim;
        EXPECT_TRUE(says(text));
        mask[extents.index(2, 8)] = 0;
        mask[extents.index(1, 5)] = algo::kRim;
        EXPECT_FALSE(says(text));
    }
}

// The bevel of a plate bends light beside the rim, all around. The middle of that defect is no place of it, and less
// light is no cause: the cure is that of the bevel.
TEST(VerdictHints, of_what_bends_light_along_a_plates_outline_says_so_with_the_worst_place_and_a_cure) {
    const algo::Extents extents{38, 38, 9, 9};
    const algo::Defect defect{.m = 18.5F, .n = 18.5F, .area = 44, .kind = algo::DefectKind::surface};
    algo::Inspection found;
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::deflection_gradient;
    found.score = 2;
    found.defects = {&defect, 1};
    std::vector<std::uint8_t> mask(extents.lenslets());
    std::vector<float> slopes(extents.lenslets());
    found.mask = mask;
    found.frobenius = slopes;
    algo::Recipe recipe;
    recipe.form = algo::PartForm::plate;
    const auto draw = [&](auto&& slope) {
        for (int n = 0; n < extents.n; ++n) {
            for (int m = 0; m < extents.m; ++m) {
                // Lenslets from six inside the border.
                const int in = std::min({m, n, extents.m - 1 - m, extents.n - 1 - n}) - 6;
                const std::size_t k = extents.index(m, n);
                mask[k] = in < 2 ? algo::kOutside : in < 4 ? algo::kRim : 0;
                slopes[k] = slope(m, n, in);
            }
        }
        return explain(found, recipe, extents);
    };
    const auto bevel = [](int m, int n, int in) { return in > 4 ? 0.1F : m == 10 && n == 13 ? 0.8F : 0.5F; };
    for (const float lost : {0.0F, 0.3F}) {
        found.frame.lost_share = lost;
        EXPECT_EQ(draw(bevel),
                  "Rejected: a surface defect along 100 % of the outline, worst at lenslet (10.0, 13.0), 2.0 times its "
                  "limit. There it may be a bevel that bends light: if good plates have it, learn a reference (hordctl "
                  "learn), or set rim_margin = 3, which hides more of what moves.");
    }
    // Bounds exceed the limit farther inside than what they bound: the slopes, which are exact, tell the width.
    found.frame.lost_share = 0;
    std::vector<float> bounds(extents.lenslets(), 5.0F);
    found.gradient = bounds;
    found.bounded = true;
    EXPECT_THAT(draw(bevel), testing::HasSubstr("or set rim_margin = 3 or wider, which hides more"));
    EXPECT_THAT(draw([](int, int, int) { return 0.1F; }), testing::HasSubstr("or set rim_margin wider."));
    found.gradient = {};
    found.bounded = false;
    // Not if the worst place is inside, and not if few lenslets beside the rim exceed the limit (four of 68).
    EXPECT_THAT(draw([&](int m, int n, int in) { return m == 18 && n == 18 ? 0.9F : bevel(m, n, in); }),
                testing::AllOf(testing::HasSubstr("of 7.5 lenslets at lenslet (18.5, 18.5), 2.0 times"),
                               testing::Not(testing::HasSubstr("bevel"))));
    EXPECT_THAT(draw([&](int m, int n, int in) { return n < 14 && m == 10 ? bevel(m, n, in) : 0.1F; }),
                testing::HasSubstr("of 7.5 lenslets at lenslet (18.5, 18.5), 2.0 times"));
    // A lens is told the place only; its own hints are others.
    recipe.form = algo::PartForm::round;
    EXPECT_THAT(draw(bevel),
                testing::AllOf(testing::HasSubstr("along 100 % of the outline, worst at lenslet (10.0, 13.0)"),
                               testing::Not(testing::HasSubstr("bevel"))));
    recipe.form = algo::PartForm::tube;
    EXPECT_THAT(draw(bevel), testing::Not(testing::HasSubstr("outline")));
}

// A bevel wider than the rim's margin. A dark place away from the rim is none.
TEST(VerdictHints, of_what_is_dark_along_the_outline_names_the_margin) {
    const algo::Extents extents{38, 38, 9, 9};
    algo::Defect defect{.m = 19, .n = 19, .area = 40};
    algo::Inspection found;
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::absorption;
    found.defects = {&defect, 1};
    std::vector<std::uint8_t> mask(extents.lenslets());
    std::vector<float> transmission(extents.lenslets(), 1);
    const auto draw = [&](auto&& is_dark) {
        for (int n = 0; n < extents.n; ++n) {
            for (int m = 0; m < extents.m; ++m) {
                // Lenslets from six inside the border.
                const int in = std::min({m, n, extents.m - 1 - m, extents.n - 1 - n}) - 6;
                const std::size_t k = extents.index(m, n);
                mask[k] = in < 2 ? algo::kOutside : in < 4 ? algo::kRim : 0;
                transmission[k] = is_dark(m, in) ? 0.4F : 1.0F;
            }
        }
        found.mask = mask;
        found.transmission = transmission;
        algo::Recipe recipe;
        recipe.form = algo::PartForm::plate;
        return explain(found, recipe, extents);
    };
    EXPECT_THAT(draw([](int, int in) { return in < 6; }),
                testing::HasSubstr("dark along 100 % of the outline, up to 2 lenslets beyond the rim: if good parts "
                                   "have such a bevel, set rim_margin = 4."));
    EXPECT_THAT(draw([](int m, int in) { return in < 5 && m < 19; }),
                testing::HasSubstr("dark along 50 % of the outline, up to 1 lenslets"));
    EXPECT_THAT(draw([](int m, int in) { return in > 6 && m < 19; }), testing::Not(testing::HasSubstr("rim_margin")));
    // Two places beside the rim, as of holes: 4 of 68 lenslets.
    EXPECT_THAT(draw([](int m, int in) { return in < 6 && (m == 18 || m == 19); }),
                testing::Not(testing::HasSubstr("rim_margin")));
    // Light through a hole is a tenth of the part or more: all glass is dark beside it, and no bevel.
    EXPECT_THAT(draw([](int, int in) { return in < 9; }),
                testing::EndsWith(" of 7.1 lenslets at lenslet (19.0, 19.0), 0.0 times its limit. Most of the part is "
                                  "that dark beside its brightest tenth, which may be a hole in tinted glass."));
    // In little light the dark level makes edges wider.
    found.frame.lost_share = 0.12F;
    EXPECT_THAT(draw([](int, int in) { return in < 6; }),
                testing::AllOf(testing::HasSubstr("The dark level, 0 DN, takes 12 % of the light"),
                               testing::Not(testing::HasSubstr("rim_margin"))));
}

// Column 20 is half of light and half of a dark edge, which is known to 4 %: 20 of its lenslets let a part lie off by
// 0.04 (6 - sqrt(2 ln N)) / 0.5 lenslet of half the light, N the three columns at the edge: 0.12.
TEST(VerdictHints, of_a_defect_at_an_edge_that_lies_elsewhere_says_how_the_part_lies) {
    algo::Recipe with = recipe(true);
    algo::Reference edge;
    edge.extents = kField;
    edge.bits = 12;
    edge.sensor = {1e4F, 1, 0};
    edge.light.assign(kField.lenslets(), 0);
    edge.mask.assign(kField.lenslets(), algo::kValid);
    for (auto& spread : edge.spread) spread.assign(kField.lenslets(), 0.04F * 0.04F);
    for (std::size_t k = 0; k < kField.lenslets(); ++k) {
        const std::size_t m = k % static_cast<std::size_t>(kField.m);
        edge.light[k] = m < 20 ? 4000 : m == 20 ? 2000 : 0;
    }
    with.reference = std::make_shared<algo::Reference>(edge);
    const auto told_of = [&](double x, float at_m) {
        algo::Inspection found;
        found.verdict = Verdict::reject;
        found.score = 1.5F;
        found.registered.outcome = algo::Registered::Outcome::found;
        found.registered.pose = {x, 0, 0};
        const std::vector<algo::Defect> one{{.m = at_m, .n = 12, .area = 2, .score = 1.5F}};
        found.defects = one;
        return explain(found, with, kField);
    };
    constexpr const char* kTold =
        "An edge of the part is there, and the part lies 0.20 lenslets and 0.0 degrees from the reference's pose: if "
        "it is good, learn from parts that lie as differently.";
    EXPECT_NE(told_of(0.2, 20).find(kTold), std::string::npos) << told_of(0.2, 20);
    EXPECT_EQ(told_of(0.2, 10).find("An edge"), std::string::npos);
    EXPECT_EQ(told_of(0.02, 20).find("An edge"), std::string::npos);
}

}  // namespace
}  // namespace hord::firmware
