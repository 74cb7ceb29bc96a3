// Why a frame was not judged, and the cure.
#include <string>
#include <tuple>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/firmware/diagnostics/told.h"

namespace hord::firmware {
namespace {

// Each is told with its cure.
void expect_told(const std::vector<std::pair<algo::Inspection, std::string>>& all) {
    for (const auto& [found, why] : all) EXPECT_EQ(told(found), "Not judged: " + why + ".");
}

TEST(UnfitText, of_light_that_is_wrong_says_why_and_what_cures_it) {
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
    const auto lenslets = [](Reason reason) {
        algo::Inspection found = unfit(reason);
        found.lenslets = {.judged = 500, .lit = 12, .saturated = 34};
        return found;
    };
    expect_told({
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
    });
}

TEST(UnfitText, of_a_part_that_is_not_there_as_it_should_be_says_why_and_what_cures_it) {
    const auto part = [](FrameFault fault) { return unfit(Reason::no_part, {.fault = fault, .parts = 2}); };
    expect_told({
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
    });
}

TEST(UnfitText, of_light_that_repeats_otherwise_names_the_geometry) {
    expect_told({
        {unfit(Reason::unexpected_geometry, {.period_x = 3, .period_y = 5}),
         "the light repeats every 3 x 5 samples, not every 9 x 9: of a frame of macro-pixels give --macro 3x5; of the "
         "sensor's own lenslet frame give --grid with its calibration (hordctl calibrate); if it was given, the frame "
         "is "
         "of another camera, or calibrate again"},
        {unfit(Reason::unexpected_geometry, {.period_x = 3}),
         "the light repeats every 3 x 9 samples, not every 9 x 9: of a frame of macro-pixels give --macro 3x9; of the "
         "sensor's own lenslet frame give --grid with its calibration (hordctl calibrate); if it was given, the frame "
         "is of another camera, or calibrate again"},
    });
}

TEST(UnfitText, tells_a_value_with_digits_enough_to_see_that_it_is_beyond_its_limit) {
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

TEST(UnfitText, of_a_dark_field_in_which_no_part_was_found_says_that_light_is_missing) {
    algo::Inspection found;
    found.verdict = algo::Verdict::unfit;
    found.reason = Reason::too_dark;
    EXPECT_THAT(told(found),
                ::testing::HasSubstr("too few lenslets of the field have light enough (at least 5 %): check"));
}

// Amber glass shows no free light: what is told must be true of it, too.
TEST(UnfitText, of_a_tube_that_deflects_no_light_says_so_whatever_its_tint) {
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

TEST(UnfitText, of_a_plate_or_a_tube_that_is_not_found_names_the_cures_of_its_form) {
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
    const auto told_of_bevels = [&](float undeflected_share) {
        const auto spot =
            unfit(Reason::unexpected_light,
                  {.fault = FrameFault::second_spot, .second_share = 0.84F, .undeflected_share = undeflected_share});
        return explain(spot, recipe, extents)
            .ends_with(
                "(calibrate again); the bevels of a good plate that bend light far can look alike: set a wider "
                "rim_margin.");
    };
    EXPECT_TRUE(told_of_bevels(0.84F));
    EXPECT_FALSE(told_of_bevels(0));  // a ghost in the free light
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

TEST(UnfitText, of_light_off_the_middle_says_by_how_much_and_to_which_side) {
    for (const auto& [x, y, where] :
         {std::tuple(0.75F, 0.5F, "to the right of"), std::tuple(-0.75F, 0.5F, "to the left of"),
          std::tuple(0.5F, 0.75F, "below"), std::tuple(0.5F, -0.75F, "above")}) {
        const auto found = unfit(Reason::unexpected_light, {.fault = FrameFault::off_centre, .x_bins = x, .y_bins = y});
        EXPECT_EQ(told(found),
                  std::string("Not judged: the free light is 0.75 bins ") + where +
                      " the middle (at most 0.5): calibrate again, or check that nothing moved.");
    }
}

TEST(UnfitText, of_a_part_that_was_not_registered_says_what_registration_says) {
    algo::Inspection found = unfit(Reason::not_registered);
    using Outcome = algo::Registered::Outcome;
    for (const auto& [outcome, why] :
         {std::pair(Outcome::too_little, "too little of it is seen to find where it lies"),
          std::pair(Outcome::too_far,
                    "it lies more than 2.5 lenslets or 3.4 degrees from the reference's pose (10 lenslets are "
                    "allowed where "
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
    EXPECT_EQ(told(found),
              "Not judged: it lies 3.2 lenslets along x and -0.3 along y from the reference's pose, turned by 0.6 "
              "degrees "
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
    found.reason = Reason::unexpected_light;
    found.registered.outcome = Outcome::blurred;
    found.registered.blur = {.known = {true, true}, .blur = {0.1, 0.34}, .allowed = {0.2, 0.2}};
    EXPECT_EQ(
        told(found),
        "Not judged: its edges are softer than those of the reference's parts (along y by 0.34, 0.20 are allowed): "
        "look for a part that moves while the light is on (a shorter flash) or that is exposed twice, and see that "
        "it lies in the measurement plane.");
    found = unfit(Reason::no_part);
    found.registered.outcome = Outcome::no_part;
    EXPECT_EQ(told(found),
              "Not judged: the field shows no edges, and the reference's parts have some: check that the part was "
              "there, the trigger's delay, and that it is the reference's part.");
}

}  // namespace
}  // namespace hord::firmware
