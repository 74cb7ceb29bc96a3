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
    const auto needs = needs_of(tinted(), {0.05, 1, {}});
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
    const auto everything = needs_of(tinted(), {0, 1, {}}), nothing = needs_of(tinted(), {5, 1, {}});
    EXPECT_EQ(everything->required().size(), 2U);
    EXPECT_TRUE(nothing->required().empty());
    EXPECT_THAT(table_of(*nothing), HasSubstr("none of the effects that it names"));
}

// Each of many small effects is within the tolerance; all of them together are not.
TEST(SceneNeeds, are_judged_together) {
    sim::Scene scene = tinted();
    scene.glass = {0, 0.01};       // 4 %
    scene.effects.fresnel = true;  // 8 %
    const auto needs = needs_of(scene, {0.1, 1, {}});
    EXPECT_LT(need(*needs, Effect::absorption).change.largest(), 0.1);
    EXPECT_LT(need(*needs, Effect::fresnel).change.largest(), 0.1);
    EXPECT_THAT(needs->required(), testing::ElementsAre(Effect::fresnel));
    EXPECT_LE(needs->left_out.largest(), 0.1);
}

TEST(SceneNeeds, tell_noise_by_what_it_does_to_an_exposure) {
    sim::Scene scene = tinted();
    scene.glass = {};
    scene.noise = {.electrons_per_dn = 1, .read_e = 0.01};
    const auto needs = needs_of(scene, {0.05, 1, {}});
    EXPECT_THAT(needs->required(), Contains(Effect::photon_noise));
    EXPECT_THAT(needs->required(), Not(Contains(Effect::read_noise)));
}

TEST(SceneNeeds, of_a_plain_scene_are_none) {
    sim::Scene scene = tinted();
    scene.glass = {};
    EXPECT_TRUE(needs_of(scene, {0, 1, {}})->effects.empty());
    scene.camera.extents.m = 1;
    EXPECT_FALSE(needs_of(scene, {0, 1, {}}));
}

}  // namespace
}  // namespace hord::lab
