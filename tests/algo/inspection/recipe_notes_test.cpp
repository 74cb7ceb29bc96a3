// What the notes of a recipe say is true of the verdicts by it.
#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/reference/reference.h"
#include "tests/algo/inspection/drawn_forms.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

// Those that a round part's usual recipe does not have.
std::vector<std::string> added_notes(const Recipe& of) {
    std::vector<std::string> added = notes(of);
    const std::vector<std::string> usual = notes(Recipe{});
    std::erase_if(added, [&](const std::string& note) { return std::ranges::find(usual, note) != usual.end(); });
    return added;
}

// The statements of the notes.
TEST(Notes, of_plates_and_webs_are_true) {
    const Extents e{40, 40, 9, 9};
    const Frame empty = noisy(drawn(e, 8, 240, [](int, int) { return Spot{}; }), {10, 2, 1}, 3);
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    ASSERT_EQ(notes(web).size(), 2U);
    EXPECT_NE(notes(web)[0].find("a hole in a film that takes less than 3 % of the light"), std::string::npos);
    EXPECT_NE(notes(web)[0].find("hordctl learn"), std::string::npos);
    EXPECT_EQ(notes(web)[1], "whether a part is there is not checked: a frame of the empty field can pass");
    EXPECT_EQ(verdict_on(empty, e, web), Verdict::pass);
    Recipe plate;
    plate.form = PartForm::plate;
    ASSERT_EQ(notes(plate).size(), 1U);
    EXPECT_NE(notes(plate)[0].find("neither darken nor deflect light"), std::string::npos);
    EXPECT_NE(notes(plate)[0].find("hordctl learn"), std::string::npos);
    EXPECT_EQ(verdict_on(empty, e, plate), Verdict::unfit);
    plate.symmetric_outline = false;
    ASSERT_EQ(notes(plate).size(), 2U);
    EXPECT_NE(notes(plate)[1].find("outline = \"any\" takes a broken part for one of another shape"),
              std::string::npos);
    plate.form = PartForm::tube;
    ASSERT_EQ(notes(plate).size(), 2U);
    EXPECT_NE(notes(plate)[1].find("outline = \"any\" takes a tube of which the field shows one end"),
              std::string::npos);
    plate.reference = std::make_shared<const Reference>();
    EXPECT_TRUE(notes(plate).empty());
}

TEST(Notes, say_that_scores_without_a_reference_change_nothing) {
    for (float Recipe::*const score : {&Recipe::reject_score, &Recipe::grow_score, &Recipe::cluster_score}) {
        Recipe recipe;
        recipe.*score += 0.25F;
        ASSERT_EQ(added_notes(recipe).size(), 1U);
        EXPECT_NE(added_notes(recipe)[0].find("it names no file"), std::string::npos);
        recipe.reference = std::make_shared<const Reference>();
        EXPECT_TRUE(added_notes(recipe).empty());
    }
}

TEST(Notes, say_that_no_defect_can_reach_the_limits) {
    const auto every_part_passes = [](const Recipe& of) {
        return !added_notes(of).empty() && added_notes(of)[0].find("every part passes") != std::string::npos;
    };
    Recipe recipe;
    recipe.transmission_limit = 0;
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.emd_limit_bins = 28;
    recipe.frobenius_limit_bins = 14;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_TRUE(every_part_passes(recipe));
    recipe.frobenius_limit_bins = 13.9F;
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.slopes = false;
    recipe.transmission_limit = 0.01F;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.light = false;
    EXPECT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_TRUE(every_part_passes(recipe));
    recipe.gradient = Feature::hellinger;
    EXPECT_FALSE(every_part_passes(recipe));
}

// The largest gradients of 15x15 bins: light that jumps between opposite corners.
TEST(Notes, say_which_limits_no_light_field_reaches) {
    const Extents e{10, 10, 15, 15};  // few lenslets: all are solved within the limit of work
    const Frame corners = drawn(e, 8, 240, [](int m, int n) {
        const bool first = ((m / 2) + (n / 2)) % 2 == 0;
        return Spot{first ? -7.0 : 7.0, first ? -7.0 : 7.0, 1};
    });
    Recipe web;
    web.form = PartForm::web;
    web.part_required = web.light = web.check_period = false;
    web.max_offset_bins = web.max_spot_bins = web.max_second_share = 0;
    web.transmission_limit = Recipe{}.transmission_limit;
    const auto told = [](const Recipe& of, const char* key) {
        return std::ranges::any_of(added_notes(of), [&](const std::string& note) {
            return note.starts_with(key) && note.find("reached by no light field") != std::string::npos;
        });
    };
    for (const bool emd : {true, false}) {
        Recipe one = web;
        one.slopes = !emd;
        if (!emd) one.gradient.reset();
        float& limit = emd ? one.emd_limit_bins : one.frobenius_limit_bins;
        const float largest = emd ? 28 : 14;
        const char* const key = emd ? "emd_bins" : "frobenius_bins";
        limit = largest - 0.5F;
        EXPECT_EQ(verdict_on(corners, e, one), Verdict::reject) << key;
        one.light = true;
        EXPECT_FALSE(told(one, key));
        limit = largest;
        EXPECT_TRUE(told(one, key));
        one.light = false;
        limit = largest + 0.1F;
        EXPECT_EQ(verdict_on(corners, e, one), Verdict::pass) << key;
    }
}

bool some_note_has(const Recipe& of, const char* text) {
    return std::ranges::any_of(added_notes(of),
                               [&](const std::string& n) { return n.find(text) != std::string::npos; });
}

TEST(Notes, say_which_light_levels_leave_little_to_judge) {
    Recipe recipe;
    recipe.dark_dn = 63;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.dark_dn = 64;
    EXPECT_TRUE(some_note_has(recipe, "dark_dn takes 64 of 255 DN"));
    recipe = {};
    recipe.max_dark_rise_dn = 60;  // on top of the default level of 3
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.max_dark_rise_dn = 61;
    EXPECT_TRUE(some_note_has(recipe, "max_dark_rise_dn lets fog or a black level of 64 of 255 DN"));
    recipe = {};
    recipe.saturated_dn = 64;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.saturated_dn = 63;
    EXPECT_TRUE(some_note_has(recipe, "a sample of 63 DN (saturated_dn) are not judged"));
    recipe.saturated_dn = 1;
    const auto refused = Pipeline::create({20, 20, 9, 9}, 8, recipe);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message().find("saturated_dn must be above the dark level, 3 DN"), std::string::npos);
}

TEST(Notes, say_that_many_lenslets_may_be_saturated) {
    Recipe recipe;
    recipe.max_saturated_share = 0.25F;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.max_saturated_share = 1;
    EXPECT_TRUE(some_note_has(recipe, "100 % of a part may be (max_saturated_share)"));
    recipe.saturated_dn = 20;
    EXPECT_TRUE(some_note_has(recipe, "passes unjudged (max_saturated_share)"));
}

TEST(Notes, say_that_light_alone_is_judged) {
    Recipe recipe;
    recipe.gradient.reset();
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.slopes = false;
    EXPECT_TRUE(some_note_has(recipe, "nothing but light is judged"));
    recipe.reference = std::make_shared<const Reference>();
    EXPECT_FALSE(some_note_has(recipe, "nothing but light is judged"));
}

TEST(Notes, say_which_scores_hardly_any_defect_reaches) {
    Recipe recipe;
    recipe.reference = std::make_shared<const Reference>();
    recipe.reject_score = 100;
    recipe.cluster_score = 1000;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.reject_score = 101;
    EXPECT_TRUE(some_note_has(recipe, "reject_score 101 is reached by hardly any defect"));
    recipe.cluster_score = 1001;
    EXPECT_TRUE(some_note_has(recipe, "cluster_score 1001 is reached by hardly any region"));
}

TEST(Notes, say_which_margins_and_zones_leave_nothing) {
    Recipe recipe;
    recipe.rim_margin = 15;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.rim_margin = 30;
    EXPECT_TRUE(some_note_has(recipe, "1 lenslets across of 61 and 51 of 111"));
    recipe.rim_margin = 500;
    EXPECT_TRUE(some_note_has(recipe, "leaves nothing to judge of a field of 1000 lenslets across or less"));
    EXPECT_FALSE(Pipeline::create({40, 1000, 3, 3}, 8, recipe));
    recipe = {};
    Zone all;
    all.use = Zone::Use::ignore;
    all.corners = {{-1, -1}, {70, -1}, {70, 70}, {-1, 70}};
    all.shape = Zone::Shape::polygon;
    recipe.zones = {all};
    EXPECT_TRUE(some_note_has(recipe, "leave nothing of a field of 61x61 lenslets"));
    recipe.zones[0].corners = {{-1, -1}, {10, -1}, {10, 70}, {-1, 70}};
    EXPECT_TRUE(added_notes(recipe).empty());
}

// A dark lenslet has no gradient, and neither have its neighbours.
TEST(Notes, say_that_dark_defects_pass_where_missing_light_is_not_judged) {
    const Extents e{24, 24, 9, 9};
    const Frame speck = noisy(drawn(e, 8, 240,
                                    [](int m, int n) {
                                        const bool dark = m > 9 && m < 14 && n > 9 && n < 14;
                                        return Spot{0, 0, dark ? 0.0 : 1.0};
                                    }),
                              {10, 2, 1}, 3);
    const auto tell = [](const Recipe& of) {
        return !added_notes(of).empty() && added_notes(of)[0].find("missing light is not judged") != std::string::npos;
    };
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    EXPECT_EQ(verdict_on(speck, e, web), Verdict::reject);
    EXPECT_FALSE(tell(web));
    Recipe without = web, at_zero = web;
    without.light = false;
    at_zero.transmission_limit = 0;
    for (Recipe& blind : {std::ref(without), std::ref(at_zero)}) {
        EXPECT_EQ(verdict_on(speck, e, blind), Verdict::pass);
        EXPECT_TRUE(tell(blind));
        blind.reference = std::make_shared<const Reference>();
        EXPECT_FALSE(tell(blind));
    }
}

TEST(Notes, say_that_a_large_least_area_passes_defects_and_which_sum_no_lenslet_holds) {
    Recipe recipe;
    recipe.min_area = 16;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.min_area = 12321;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_NE(added_notes(recipe)[0].find("fewer than 12321 lenslets pass"), std::string::npos);
    EXPECT_NE(added_notes(recipe)[0].find("125 lenslets across"), std::string::npos);
    recipe = {};
    recipe.min_sum_dn = 81 * 255;
    EXPECT_TRUE(added_notes(recipe).empty());
    const Extents e{20, 20, 9, 9};
    EXPECT_TRUE(Pipeline::create(e, 8, recipe));
    ++recipe.min_sum_dn;
    EXPECT_EQ(added_notes(recipe).size(), 1U);
    const auto refused = Pipeline::create(e, 8, recipe);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message().find("min_sum_dn 20656 is more than a lenslet of 81 bins can hold, 20655"),
              std::string::npos);
    EXPECT_TRUE(Pipeline::create(e, 10, recipe));
}

}  // namespace
}  // namespace hord::algo
