#include "lab/scene/scene_needs.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::lab {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

// Absorption of a third of the light and a dispersion that moves light by a thousandth of a bin.
sim::Scene tinted() {
    sim::Scene scene;
    scene.part = sim::DoubleConvexLens{};
    scene.camera.extents = {25, 25, 9, 9};
    scene.glass = {200, 0.1};
    scene.light.wavelength_nm = 580;
    return scene;
}

const EffectNeed& need(const SceneNeeds& needs, Effect effect) {
    return *std::find_if(needs.effects.begin(), needs.effects.end(),
                         [&](const EffectNeed& n) { return n.effect == effect; });
}

TEST(SceneNeeds, keeps_what_changes_a_feature_by_more_than_the_tolerance_and_drops_the_rest) {
    const auto needs = needs_of(tinted(), {0.05, 1, {}, false, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    ASSERT_EQ(needs->effects.size(), 2U);
    EXPECT_TRUE(need(*needs, Effect::absorption).required);
    EXPECT_GT(need(*needs, Effect::absorption).change.transmission, 0.25);
    EXPECT_LT(need(*needs, Effect::absorption).change.emd, 0.05);  // normalising erases it
    EXPECT_FALSE(need(*needs, Effect::dispersion).required);
    EXPECT_LT(needs->left_out.largest(), 0.05);
    EXPECT_GT(needs->lenslets, 300);
    EXPECT_THAT(table_of(*needs), HasSubstr("requires: absorption."));
}

TEST(SceneNeeds, depend_on_the_tolerance) {
    const auto everything = needs_of(tinted(), {0, 1, {}, false, {}}),
               nothing = needs_of(tinted(), {5, 1, {}, false, {}});
    EXPECT_EQ(everything->required().size(), 2U);
    EXPECT_TRUE(nothing->required().empty());
    EXPECT_THAT(table_of(*nothing), HasSubstr("none of the effects that it names"));
}

// Each of many small effects is within the tolerance; all of them together are not.
TEST(SceneNeeds, are_judged_together) {
    sim::Scene scene = tinted();
    scene.glass = {0, 0.01};       // 4 %
    scene.effects.fresnel = true;  // 8 %
    const auto needs = needs_of(scene, {0.1, 1, {}, false, {}});
    EXPECT_LT(need(*needs, Effect::absorption).change.largest(), 0.1);
    EXPECT_LT(need(*needs, Effect::fresnel).change.largest(), 0.1);
    EXPECT_THAT(needs->required(), testing::ElementsAre(Effect::fresnel));
    EXPECT_LE(needs->left_out.largest(), 0.1);
}

TEST(SceneNeeds, tell_noise_by_what_it_does_to_an_exposure) {
    sim::Scene scene = tinted();
    scene.glass = {};
    scene.noise = {.electrons_per_dn = 1, .read_e = 0.01};
    const auto needs = needs_of(scene, {0.05, 1, {}, false, {}});
    EXPECT_THAT(needs->required(), Contains(Effect::photon_noise));
    EXPECT_THAT(needs->required(), Not(Contains(Effect::read_noise)));
}

sim::Scene good_lens() {
    sim::Scene scene;
    scene.part = sim::DoubleConvexLens{};
    scene.camera.extents = {61, 61, 9, 9};
    return scene;
}

// One dark lenslet of a thousand: no percentile sees it, the verdict does.
TEST(SceneNeeds, a_grain_of_dust_that_flips_the_verdict_is_required) {
    sim::Scene scene = good_lens();
    scene.camera.dust = {{sim::Dust::Plane::lenslets, 2, 1, 0.4, 0}};
    const auto needs = needs_of(scene, {0.05, 1, {}, false, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    const EffectNeed& dust = need(*needs, Effect::dust);
    EXPECT_LT(dust.change.largest(), 0.05);
    EXPECT_EQ(dust.change.verdict, algo::Verdict::reject);
    EXPECT_EQ(dust.change.verdict_without, algo::Verdict::pass);
    EXPECT_GT(dust.change.false_defects, dust.change.false_defects_without);
    EXPECT_TRUE(dust.required);
    EXPECT_THAT(table_of(*needs), HasSubstr("required: verdict"));
}

// A strobe that is too long: the bubble is smeared over several lenslets.
TEST(SceneNeeds, motion_that_takes_the_contrast_of_a_defect_is_required) {
    sim::Scene scene = good_lens();
    scene.camera.extents = {45, 45, 9, 9};
    scene.defects = {sim::AirBubble{{1, 1, 0}, 0.5}};
    scene.motion = {1000, 0, 1200};
    const auto needs = needs_of(scene, {5, 1, {}, false, {}});  // the field does not matter
    ASSERT_TRUE(needs) << needs.error().message();
    const EffectNeed& motion = need(*needs, Effect::motion);
    EXPECT_GT(motion.change.contrast_change(0), kContrastChange);  // of the EMD gradient
    EXPECT_TRUE(motion.required);
}

// The gradients do not see a speck that lets half of the light through: the light does.
TEST(SceneNeeds, the_contrast_of_a_defect_is_that_of_the_feature_that_sees_it) {
    sim::Scene scene = good_lens();
    scene.camera.extents = {31, 31, 9, 9};
    scene.defects = {sim::AbsorbingSpeck{{0, 0, 0}, 2, 0.5}};
    scene.effects.fresnel = true;
    const auto needs = needs_of(scene, {5, 1, {}, false, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    const FeatureChange& fresnel = need(*needs, Effect::fresnel).change;
    EXPECT_GT(fresnel.contrast[2], 5);
    EXPECT_LT(fresnel.contrast[0], 2);
    EXPECT_EQ(fresnel.shown(), 2U);
    EXPECT_THAT(table_of(*needs), HasSubstr("light: "));
}

// The relay's first lens is narrower than the part: the light of its outer lenslets does not get through.
TEST(SceneNeeds, vignetting_that_flips_the_verdict_is_required) {
    sim::Scene scene = good_lens();
    scene.camera.relay.lens1_radius_mm = 9;
    const auto needs = needs_of(scene, {10, 1, {}, false, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    const EffectNeed& vignetting = need(*needs, Effect::vignetting);
    EXPECT_NE(vignetting.change.verdict, algo::Verdict::pass);
    EXPECT_EQ(vignetting.change.verdict_without, algo::Verdict::pass);
    EXPECT_TRUE(vignetting.required);
}

// A strobe that is too long: a good part is smeared by three lenslets.
TEST(SceneNeeds, motion_that_flips_the_verdict_is_required) {
    sim::Scene scene = good_lens();
    scene.camera.extents = {45, 45, 9, 9};
    scene.motion = {1000, 0, 1600};
    const auto needs = needs_of(scene, {10, 1, {}, false, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    const EffectNeed& motion = need(*needs, Effect::motion);
    EXPECT_EQ(motion.change.verdict, algo::Verdict::reject);
    EXPECT_EQ(motion.change.verdict_without, algo::Verdict::pass);
    EXPECT_TRUE(motion.required);
}

TEST(SceneNeeds, effects_that_a_scene_does_not_name_are_tried_at_typical_values) {
    const auto needs = needs_of(good_lens(), {0.05, 1, {}, true, {}});
    ASSERT_TRUE(needs) << needs.error().message();
    EXPECT_TRUE(needs->required().empty());
    EXPECT_GE(needs->effects.size(), 12U);
    EXPECT_THAT(needs->missing(), Contains(Effect::fresnel));        // 8 % of the light
    EXPECT_THAT(needs->missing(), Not(Contains(Effect::pedestal)));  // less than the dark level
    EXPECT_THAT(table_of(*needs), HasSubstr("would need: "));
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto effect = static_cast<Effect>(k);
        EXPECT_TRUE(names(with_typical(good_lens(), effect), effect)) << name_of(effect);
    }
}

// A plate without bevels has no outline that a recipe for a round part could find.
TEST(SceneNeeds, of_a_scene_that_the_recipe_cannot_judge_say_so) {
    sim::Scene scene = tinted();
    EXPECT_THAT(table_of(*needs_of(scene, {0.05, 1, {}, false, {}})), Not(HasSubstr("unfit")));
    scene.part = sim::Plate{};
    EXPECT_THAT(table_of(*needs_of(scene, {0.05, 1, {}, false, {}})), HasSubstr("finds this scene unfit (no-part)"));
}

TEST(SceneNeeds, of_a_plain_scene_are_none) {
    sim::Scene scene = tinted();
    scene.glass = {};
    EXPECT_TRUE(needs_of(scene, {0, 1, {}, false, {}})->effects.empty());
    scene.camera.extents.m = 1;
    EXPECT_FALSE(needs_of(scene, {0, 1, {}, false, {}}));
}

}  // namespace
}  // namespace hord::lab
