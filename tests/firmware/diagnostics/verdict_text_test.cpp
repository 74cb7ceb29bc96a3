// The sentence of every verdict and reason, with and without a reference.
#include "firmware/diagnostics/verdict_text.h"

#include <algorithm>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/reference/reference.h"

namespace hord::firmware {
namespace {

using algo::FrameFault;
using algo::Reason;
using algo::Verdict;

constexpr algo::Extents kField{41, 31, 9, 9};

algo::Recipe recipe(bool with_reference, float lenslet_mm = 0) {
    algo::Recipe recipe;
    recipe.lenslet_mm = lenslet_mm;
    if (with_reference) recipe.reference = std::make_shared<algo::Reference>();
    return recipe;
}

// The same sentence with and without a reference.
std::string told(const algo::Inspection& found, float lenslet_mm = 0) {
    std::string sentence = explain(found, recipe(false, lenslet_mm), kField);
    EXPECT_EQ(explain(found, recipe(true, lenslet_mm), kField), sentence);
    return sentence;
}

algo::Inspection unfit(Reason reason, const algo::FrameFindings& frame = {}) {
    algo::Inspection found;
    found.verdict = Verdict::unfit;
    found.reason = reason;
    found.frame = frame;
    return found;
}

TEST(VerdictText, of_a_part_that_passed_says_how_near_to_its_limit_it_came) {
    algo::Inspection found;
    found.verdict = Verdict::pass;
    found.reason = Reason::none;
    found.score = 0.424F;
    EXPECT_EQ(told(found), "Passed: the worst place reaches 42 % of its limit.");
    found.bounded = true;
    EXPECT_EQ(told(found),
              "Passed: the worst place reaches at most 42 % of its limit. Some values are bounds: the limit of work "
              "was reached.");
    found.out_of_time = true;
    EXPECT_EQ(told(found),
              "Passed: the worst place reaches at most 42 % of its limit. Some values are bounds: the time ran out.");
}

// What several lenslets show together (algo/reference/pooled_scores.h).
TEST(VerdictText, of_a_weak_defect_names_haze_and_striae_with_their_length) {
    const auto told_of = [](algo::DefectKind kind, float length) {
        algo::Inspection found;
        found.verdict = Verdict::reject;
        found.score = 1.5F;
        const std::vector<algo::Defect> one{
            {.m = 20, .n = 12, .area = 16, .kind = kind, .length = length, .width = 2, .score = 1.5F, .weak = true}};
        found.defects = one;
        return told(found);
    };
    EXPECT_EQ(told_of(algo::DefectKind::surface, 8),
              "Rejected: a stria of 8.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::scattering, 3),
              "Rejected: haze of 3.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::scratch, 8),
              "Rejected: a scratch of 8.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::surface, 4.3F),
              "Rejected: a surface defect of 4.3 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
}

// A shift of all light against the reference, as moved optics make, looks like a surface all over the part.
TEST(VerdictText, of_a_surface_says_where_the_light_beside_the_part_moved_too) {
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

TEST(VerdictText, of_a_rejected_part_says_what_was_found_how_large_and_where) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    found.score = 2.5F;
    std::vector<algo::Defect> defects{{.m = 25, .n = 5, .area = 9, .peak = 1}};
    for (const Reason reason : {Reason::neighbours_disagree, Reason::deflection_gradient, Reason::absorption}) {
        found.reason = reason;
        for (const auto& [kind, name] : {std::pair(algo::DefectKind::unknown, "a defect"),
                                         std::pair(algo::DefectKind::scattering, "a scattering defect"),
                                         std::pair(algo::DefectKind::absorbing, "an absorbing defect"),
                                         std::pair(algo::DefectKind::surface, "a surface defect")}) {
            defects[0].kind = kind;
            found.defects = defects;
            EXPECT_EQ(
                told(found),
                std::string("Rejected: ") + name + " of 3.4 lenslets at lenslet (25.0, 5.0), 2.5 times its limit.");
        }
    }
    defects[0].radius = 1.2F;  // by the light
    EXPECT_THAT(told(found), ::testing::HasSubstr(" of 2.4 lenslets "));
    defects[0].kind = algo::DefectKind::scratch;
    defects[0].length = 12;
    EXPECT_EQ(told(found), "Rejected: a scratch of 12.0 lenslets at lenslet (25.0, 5.0), 2.5 times its limit.");
    EXPECT_EQ(told(found, 0.2F), "Rejected: a scratch of 2.4 mm at (1.00, -2.00) mm, 2.5 times its limit.");
    defects.resize(2, {.m = 3, .n = 4, .area = 1});
    found.defects = defects;
    EXPECT_THAT(told(found), ::testing::EndsWith("; 1 weaker one."));
    defects.resize(3);
    found.defects = defects;
    found.bounded = true;
    EXPECT_THAT(told(found),
                ::testing::EndsWith("at most 2.5 times its limit; 2 weaker ones. Some values are bounds: "
                                    "the limit of work was reached."));
}

TEST(VerdictText, of_a_lone_sample_says_that_the_pixel_may_be_warm) {
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

TEST(VerdictText, tells_a_value_with_digits_enough_to_see_that_it_is_beyond_its_limit) {
    const algo::Recipe recipe;
    const auto share_of = [&](float lost) {
        const std::string text =
            explain(unfit(Reason::too_dark, {.fault = FrameFault::dim, .lost_share = lost}), recipe, kField);
        return text.substr(0, text.find(" of the light"));
    };
    EXPECT_THAT(share_of(0.31F), ::testing::EndsWith("takes 31 %"));
    EXPECT_THAT(share_of(0.203F), ::testing::EndsWith("takes 20.3 %"));
    EXPECT_THAT(share_of(0.2004F), ::testing::EndsWith("takes 20.04 %"));
    EXPECT_THAT(
        explain(unfit(Reason::no_part, {.fault = FrameFault::no_outline, .sharp_share = 0.497F}), recipe, kField),
        ::testing::HasSubstr("across 49.7 % of the outline only (at least 50 %)"));
}

TEST(VerdictText, of_two_lines_of_one_length_names_the_form_of_a_tube) {
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
TEST(VerdictText, of_a_line_along_a_tube_names_its_own_slope) {
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

TEST(VerdictText, of_an_unfit_frame_says_why_and_what_cures_it) {
    const auto light = [](FrameFault fault) {
        return unfit(Reason::unexpected_light,
                     {.fault = fault,
                      .pedestal_dn = 12.34F,
                      .dark_noise_dn = 5.6F,
                      .wanted_dark_dn = 30,
                      .dark_limit_dn = 11,
                      .noise_limit_dn = 19,
                      .spot_x_bins = 1.5F,
                      .spot_y_bins = 1.25F,
                      .second_share = 0.071F,
                      .free_beside = 0.25F});
    };
    const auto part = [](FrameFault fault) { return unfit(Reason::no_part, {.fault = fault, .parts = 2}); };
    const auto lenslets = [](Reason reason) {
        algo::Inspection found = unfit(reason);
        found.lenslets = {.judged = 500, .lit = 12, .saturated = 34};
        return found;
    };
    const std::vector<std::pair<algo::Inspection, std::string>> all{
        {lenslets(Reason::too_dark),
         "12 of 500 lenslets of the part have light enough (at least 5 %): check that the light flashes while the "
         "sensor exposes, and raise its current, the exposure or the gain"},
        {lenslets(Reason::saturated),
         "34 of 500 lenslets of the part are saturated (at most 2 %): lower the exposure, the light's current or the "
         "gain"},
        {unfit(Reason::nothing_to_see),
         "no lenslet is left to judge: the part is too small for its rim margin, or the zones leave nothing of it; "
         "lower rim_margin, or see to the zones"},
        {light(FrameFault::pedestal),
         "the dark bins read 12.3 DN (at most 11): keep stray light out, lower the sensor's black level, or raise "
         "[light] max_dark_rise_dn"},
        {light(FrameFault::noise),
         "the frame is too noisy: the dark bins vary by 5.6 DN about 12.3 DN, and 30 DN would have to be subtracted "
         "(at most 19): lower the sensor's gain, cool it, or raise [light] max_dark_rise_dn"},
        {light(FrameFault::wide_spot),
         "spots are 1.5 x 1.2 bins wide (at most 1.0): focus the collimator and the lenslets, or raise [light] "
         "max_spot_bins for a wide source"},
        {unfit(Reason::unexpected_light,
               {.fault = FrameFault::wide_inside,
                .spot_x_bins = 0.4F,
                .spot_y_bins = 0.5F,
                .inside_x_bins = 0.9F,
                .inside_y_bins = 1}),
         "spots between the edges are 0.9 x 1.0 bins wide, beside them 0.4 x 0.5: a plate makes none wider; check that "
         "it is there and does not scatter light all over (haze, a rough face, dirt), or learn a reference (hordctl "
         "learn)"},
        {unfit(Reason::unexpected_light, {.fault = FrameFault::fog_beside, .floor_dn = 9.04F, .inside_floor_dn = 0.5F}),
         "bins without light read 9.0 DN beside the part and 0.5 DN behind it, where no glass takes light away: keep "
         "fog and stray light out, or learn a reference (hordctl learn)"},
        {light(FrameFault::second_spot),
         "7 % of the light is in a second spot: look for a reflection, a second lamp, two exposures in one frame, or "
         "light of the next lenslet (calibrate again)"},
        {unfit(Reason::unexpected_light,
               {.fault = FrameFault::alternating, .alternation_bins = 0.25F, .alternation_light = 0.1F}),
         "neighbouring lenslets differ in turn, by 0.50 bins or 20 % of their light: look for interlaced exposures, "
         "and "
         "for taps of the sensor that differ"},
        {unfit(Reason::unexpected_light,
               {.fault = FrameFault::alternating, .alternation_bins = 2.5F, .alternation_light = 0.1F}),
         "neighbouring lenslets differ in turn, by 5.00 bins or 20 % of their light: macro-pixels of 18x18, 18x9 or "
         "9x18 samples do so: give --macro; else look for interlaced exposures, and for taps of the sensor that "
         "differ"},
        {unfit(Reason::unexpected_geometry, {.fault = FrameFault::split_spots, .split_share = 0.4F}),
         "in 40 % of the lenslets the light lies at opposite edges of the bins, as if the macro-pixels drifted against "
         "the frame: give the frame as the sensor recorded it, or calibrate again"},
        {unfit(Reason::unexpected_light, {.fault = FrameFault::glare, .glare_share = 0.04F}),
         "4 % of the part is far brighter than the free light beside it: look for a second lamp, a reflection, or "
         "stray "
         "light"},
        {light(FrameFault::interrupted),
         "a row or column of lenslets shows free light in 25 % of what lies beside the part (at least 50 %): look for "
         "lost rows of the frame, something across the field, a part that reaches from border to border, or bins that "
         "do not lie where the light does (calibrate again)"},
        {unfit(Reason::unexpected_light, {.fault = FrameFault::blurred_edge, .edge_width = 4}),
         "the light falls over 4 lenslets at the part's edges (at most 2): look for a part that moves while the light "
         "is on (a shorter flash) or that is exposed twice, and see that it lies in the measurement plane"},
        {unfit(Reason::too_dark, {.fault = FrameFault::dim, .lost_share = 0.31F}),
         "the dark level, 0 DN, takes 31 % of the light, and what is seen is not surely one whole part, as it must be "
         "above 20 %: check that the light flashes while the sensor exposes, and raise its current, the exposure or "
         "the gain"},
        {unfit(Reason::unexpected_geometry, {.fault = FrameFault::turned, .turned_rad = 0.0349F}),
         "the free light drifts as if the bins were turned against the frame by 2.00 degrees: calibrate again, or set "
         "the camera straight"},
        {part(FrameFault::nothing),
         "nothing in the field is large enough to be a part (a sixteenth of it): check that the part was there, and "
         "the "
         "trigger's delay"},
        {unfit(Reason::no_part, {.fault = FrameFault::hollow, .deflecting = 0.1F}),
         "90 % of what the outline encloses does not deflect light, as if nothing were in it: check that the part is "
         "there; of a flat one learn a reference (hordctl learn), or set [part] form = \"plate\""},
        {unfit(Reason::no_part, {.fault = FrameFault::unproven, .shaded = 0.1F}),
         "10 % of the steps across the edges lead to less light (at least 75 %), and hardly any light between them is "
         "deflected, as if only hairs or a frame were there: check that the plate is there; of one whose faces are "
         "coated learn a reference (hordctl learn)"},
        {part(FrameFault::fills_field),
         "no free light surrounds the part: show the whole part, calibrate again if free light does surround it (the "
         "bins then do not lie where the light does), or set [part] form = \"web\" if it fills the field"},
        {unfit(Reason::no_part, {.fault = FrameFault::no_outline, .sharp_share = 0.4F}),
         "the light jumps across 40 % of the outline only (at least 50 %), as beside an uneven lamp or edges narrower "
         "than a lenslet: check the lamp and the optics; of a part with such edges learn a reference (hordctl learn), "
         "or use smaller lenslets"},
        {unfit(Reason::no_part, {.fault = FrameFault::no_steps, .shaded_steps = 5}),
         "the light on both sides of the plate's edges can be compared at 5 places only (at least 8), and hardly any "
         "light inside is deflected: show 4 lenslets of free light or more beside the edges (a larger field, or a "
         "smaller rim_margin), or learn a reference (hordctl learn)"},
        {part(FrameFault::shadow),
         "the light grows away from the edges as beside the soft shadow of hairs or of a frame, and hardly any light "
         "between them is deflected: check that the plate is there, and that the lamp is not darker in the middle; or "
         "learn a reference (hordctl learn)"},
        {part(FrameFault::clear_middle),
         "light is lost across the plate's edges, but its middle is as light as the field beside it, as where a hole "
         "is, or hairs or a frame with a soft shadow: check that the plate is there and whole; of one with a hole "
         "learn "
         "a reference (hordctl learn)"},
        {part(FrameFault::several),
         "there are 2 parts in the field: space them, or set [part] form = \"plate\" if it is one whose middle does "
         "not "
         "deflect light"},
        {part(FrameFault::cut_by_field),
         "the field's border cuts the part, or the frame's last rows are lost: set the trigger's delay, or show the "
         "whole "
         "part"},
        {part(FrameFault::lopsided),
         "the part's outline is not symmetric, as if a piece were missing: check the part, or set [part] outline = "
         "\"any\" if it has this shape"},
        {unfit(Reason::no_part, {.fault = FrameFault::notched, .convexity = 0.7F}),
         "the part's outline is not convex, as if pieces were missing (30 % of its hull): check the part, or set "
         "[part] outline = \"any\" if it has this shape"},
        {part(FrameFault::no_flanks),
         "the edges of the tube show no flank on both sides: show it whole, or set [part] form if it is none; of one "
         "whose walls hardly darken or bend light learn a reference (hordctl learn)"},
        {unfit(Reason::no_part, {.fault = FrameFault::not_flat, .deflecting = 0.9F}),
         "90 % of what the edges enclose deflects light, and the field cuts it: show the whole part, check the frame "
         "(lost samples move all light behind them), or learn a reference (hordctl learn)"},
        {unfit(Reason::unexpected_geometry, {.period_x = 3, .period_y = 5}),
         "the light repeats every 3 x 5 samples, not every 9 x 9: give --macro 3x5; of the sensor's own lenslet frame "
         "give --grid with its calibration (hordctl calibrate), or calibrate again"},
        {unfit(Reason::unexpected_geometry, {.period_x = 3}),
         "the light repeats every 3 x 9 samples, not every 9 x 9: give --macro 3x9; of the sensor's own lenslet frame "
         "give --grid with its calibration (hordctl calibrate), or calibrate again"},
    };
    for (const auto& [found, why] : all) EXPECT_EQ(told(found), "Not judged: " + why + ".");
}

TEST(VerdictText, of_a_dark_field_in_which_no_part_was_found_says_that_light_is_missing) {
    algo::Inspection found;
    found.verdict = algo::Verdict::unfit;
    found.reason = Reason::too_dark;
    EXPECT_THAT(told(found),
                ::testing::HasSubstr("too few lenslets of the field have light enough (at least 5 %): check"));
}

// Amber glass shows no free light: what is told must be true of it, too.
TEST(VerdictText, of_a_tube_that_deflects_no_light_says_so_whatever_its_tint) {
    algo::Inspection found;
    found.verdict = algo::Verdict::unfit;
    found.reason = Reason::no_part;
    found.frame = {.fault = FrameFault::hollow, .deflecting = 0.1F};
    algo::Recipe recipe;
    recipe.form = algo::PartForm::tube;
    EXPECT_THAT(
        explain(found, recipe, kField),
        ::testing::StartsWith("Not judged: 90 % of the tube between its flanks does not deflect light, as if "));
}

TEST(VerdictText, of_missing_material_says_where_and_how_much_light_passes) {
    algo::Inspection found;
    const algo::Defect hole{.m = 20, .n = 35, .area = 9, .peak = 0.082F, .length = 3, .width = 3};
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::missing_material;
    found.score = 2.3F;
    found.defects = {&hole, 1};
    EXPECT_EQ(told(found),
              "Rejected: light passes as if material were missing at lenslet (20.0, 35.0): 8 % more than beside it, "
              "over 3.0 lenslets, 2.3 times its limit. If good parts are thinner or clearer there, learn a reference "
              "(hordctl "
              "learn).");
}

TEST(VerdictText, of_a_reject_in_little_light_names_the_light) {
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

TEST(VerdictText, of_a_steep_part_and_of_a_line_at_a_plates_edge_says_what_else_it_may_be) {
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
    EXPECT_FALSE(says("the plate's bevel"));
    mask[extents.index(2, 8)] = algo::kRim;
    EXPECT_TRUE(says("the plate's bevel"));
    mask[extents.index(2, 8)] = 0;
    mask[extents.index(1, 5)] = algo::kRim;
    EXPECT_FALSE(says("the plate's bevel"));
}

// A bevel wider than the rim's margin. A dark place away from the rim is none.
TEST(VerdictText, of_what_is_dark_along_the_outline_names_the_margin) {
    const algo::Extents extents{20, 20, 9, 9};
    algo::Defect defect{.m = 10, .n = 10, .area = 40};
    algo::Inspection found;
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::absorption;
    found.defects = {&defect, 1};
    std::vector<std::uint8_t> mask(extents.lenslets());
    std::vector<float> transmission(extents.lenslets(), 1);
    const auto draw = [&](auto&& is_dark) {
        for (int n = 0; n < extents.n; ++n) {
            for (int m = 0; m < extents.m; ++m) {
                const int in = std::min({m, n, extents.m - 1 - m, extents.n - 1 - n});  // lenslets from the border
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
    EXPECT_THAT(draw([](int m, int in) { return in < 5 && m < 10; }),
                testing::HasSubstr("dark along 50 % of the outline, up to 1 lenslets"));
    EXPECT_THAT(draw([](int m, int in) { return in > 6 && m < 10; }), testing::Not(testing::HasSubstr("rim_margin")));
    // Two places beside the rim, as of holes: 4 of 44 lenslets.
    EXPECT_THAT(draw([](int m, int in) { return in < 6 && (m == 9 || m == 10); }),
                testing::Not(testing::HasSubstr("rim_margin")));
    // In little light the dark level makes edges wider.
    found.frame.lost_share = 0.12F;
    EXPECT_THAT(draw([](int, int in) { return in < 6; }),
                testing::AllOf(testing::HasSubstr("The dark level, 0 DN, takes 12 % of the light"),
                               testing::Not(testing::HasSubstr("rim_margin"))));
}

TEST(VerdictText, of_a_plate_or_a_tube_that_is_not_found_names_the_cures_of_its_form) {
    algo::Recipe recipe;
    const algo::Extents extents{111, 111, 9, 9};
    recipe.form = algo::PartForm::plate;
    EXPECT_NE(explain(unfit(Reason::no_part, {.fault = FrameFault::nothing}), recipe, extents)
                  .find("bevels narrower than a lenslet"),
              std::string::npos);
    EXPECT_NE(explain(unfit(Reason::no_part, {.fault = FrameFault::lopsided}), recipe, extents)
                  .find("as if a corner or a piece of its edge were missing, or an edge were not seen"),
              std::string::npos);
    EXPECT_NE(explain(unfit(Reason::unexpected_light, {.fault = FrameFault::blurred_edge}), recipe, extents)
                  .find("the bevels of a good plate that bend light can look alike: learn a reference (hordctl learn)"),
              std::string::npos);
    EXPECT_NE(explain(unfit(Reason::no_part, {.fault = FrameFault::cut_by_field}), recipe, extents)
                  .find("show the whole plate; of one that is larger than the field in every frame set [part] outline "
                        "= \"any\""),
              std::string::npos);
    recipe.form = algo::PartForm::tube;
    EXPECT_NE(explain(unfit(Reason::no_part, {.fault = FrameFault::cut_by_field}), recipe, extents)
                  .find("show both ends or none; if every frame shows one end set [part] outline = \"any\""),
              std::string::npos);
    EXPECT_NE(explain(unfit(Reason::no_part, {.fault = FrameFault::hollow, .deflecting = 0}), recipe, extents)
                  .find("the bins may be too wide"),
              std::string::npos);
    for (const FrameFault fault : {FrameFault::nothing, FrameFault::no_outline, FrameFault::several,
                                   FrameFault::no_flanks, FrameFault::hollow}) {
        const std::string text = explain(unfit(Reason::no_part, {.fault = fault, .parts = 2}), recipe, extents);
        EXPECT_NE(text.find("hordctl learn"), std::string::npos) << text;
        EXPECT_EQ(text.find("form = \"plate\""), std::string::npos) << text;
    }
    EXPECT_NE(explain(unfit(Reason::nothing_to_see), recipe, extents).find("between the tube's flanks"),
              std::string::npos);
}

TEST(VerdictText, of_light_off_the_middle_says_by_how_much_and_to_which_side) {
    for (const auto& [x, y, where] :
         {std::tuple(0.75F, 0.5F, "to the right of"), std::tuple(-0.75F, 0.5F, "to the left of"),
          std::tuple(0.5F, 0.75F, "below"), std::tuple(0.5F, -0.75F, "above")}) {
        const auto found = unfit(Reason::unexpected_light, {.fault = FrameFault::off_centre, .x_bins = x, .y_bins = y});
        EXPECT_EQ(told(found),
                  std::string("Not judged: the free light is 0.75 bins ") + where +
                      " the middle (at most 0.5): calibrate again, or check that nothing moved.");
    }
}

// Column 20 is half of light and half of a dark edge, which is known to 4 %: 20 of its lenslets let a part lie off by
// 0.04 (6 - sqrt(2 ln N)) / 0.5 lenslet of half the light, N the three columns at the edge: 0.12.
TEST(VerdictText, of_a_defect_at_an_edge_that_lies_elsewhere_says_how_the_part_lies) {
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

TEST(VerdictText, of_a_part_that_was_not_registered_says_what_registration_says) {
    algo::Inspection found = unfit(Reason::not_registered);
    using Outcome = algo::Registered::Outcome;
    for (const auto& [outcome, why] :
         {std::pair(Outcome::too_little, "too little of it is seen to find where it lies"),
          std::pair(
              Outcome::too_far,
              "it lies more than 2.5 lenslets or 3.4 degrees from the reference's pose (10 lenslets are allowed where "
              "its edges are found): lay it closer, or learn from parts that lie like it"),
          std::pair(Outcome::other_edges,
                    "its edges are not where the reference's parts have theirs: lay it within 2.5 lenslets and 3.4 "
                    "degrees of them, or see whether it is another part"),
          std::pair(Outcome::foreign, "it does not look like the reference's parts"),
          std::pair(Outcome::unsettled,
                    "where it lies cannot be settled: see whether it is the reference's part and whole, or learn again "
                    "from parts that lie within half a lenslet of each other")}) {
        found.registered.outcome = outcome;
        EXPECT_EQ(told(found), std::string("Not judged: ") + why + ".");
    }
    found.registered.outcome = Outcome::too_far;
    found.registered.pose = {3.24, -0.3, 0.01}, found.registered.missing_edges = 0.1;
    EXPECT_EQ(
        told(found),
        "Not judged: it lies 3.2 lenslets along x and -0.3 along y from the reference's pose, turned by 0.6 degrees "
        "(2.5 lenslets and 3.4 degrees are allowed): lay it closer, or learn from parts that lie like it.");
    found.registered.farthest = {10, 2.5}, found.registered.pose = {-0.4, 3.1, 0};
    EXPECT_EQ(told(found),
              "Not judged: it lies -0.4 lenslets along x and 3.1 along y from the reference's pose, turned by 0.0 "
              "degrees (10 lenslets along x, 2.5 along y if its edges are found there, and 3.4 degrees are allowed): "
              "lay it closer, or learn from parts that lie like it.");
    found.registered.outcome = Outcome::other_size;
    found.registered.size = {.known = {true, true}, .wider = {0.1, -1.25}, .allowed = {0.3, 0.4}};
    EXPECT_EQ(told(found),
              "Not judged: its opposite edges lie 1.25 lenslets closer together along y than those of the reference's "
              "parts (0.40 are allowed): see whether it is another part, or learn from good parts of its size, too.");
    found = unfit(Reason::no_part);
    found.registered.outcome = Outcome::no_part;
    EXPECT_EQ(told(found),
              "Not judged: the field shows no edges, and the reference's parts have some: check that the part was "
              "there, the trigger's delay, and that it is the reference's part.");
}

}  // namespace
}  // namespace hord::firmware
