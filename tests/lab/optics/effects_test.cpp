#include "lab/optics/effects.h"

#include <cstring>

#include <gtest/gtest.h>

#include "tests/hal_sim/optics/camera/small_scene.h"

namespace hord::lab {
namespace {

using namespace sim;

Scene with_every_effect() {
    Scene scene = small(Plate{}, 5);
    scene.camera.field_mm = 12;
    scene.glass = {30, 0.05};
    scene.light.wavelength_nm = 470;
    scene.effects = {true, true, true, true};
    scene.camera.relay = {100, 100, 12, 30, 30};
    scene.camera.dust = {{Dust::Plane::lens1, 0, 0, 0.3, 0.5}};
    scene.motion = {1000, 0, 500};
    scene.noise = {
        .electrons_per_dn = 10, .read_e = 2, .dark_dn = 4, .dark_e_per_s = 10000, .prnu = 0.01, .full_well_e = 10000};
    return scene;
}

TEST(Effects, a_scene_says_which_it_names_and_loses_them_one_by_one) {
    Scene scene = with_every_effect();
    EXPECT_TRUE(problems(scene).empty()) << problems(scene).front().message();
    EXPECT_EQ(effects_of(scene).size(), kEffects);
    EXPECT_TRUE(effects_of(Scene{}).empty());
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto effect = static_cast<Effect>(k);
        const Scene less = without(scene, effect);
        EXPECT_FALSE(names(less, effect)) << name_of(effect);
        EXPECT_TRUE(problems(less).empty()) << name_of(effect);
        EXPECT_EQ(effects_of(less).size(), kEffects - (effect == Effect::fresnel ? 2 : 1)) << name_of(effect);
    }
}

TEST(Effects, each_changes_the_frame_and_without_all_of_them_it_is_the_plain_one) {
    Scene scene = with_every_effect();
    std::get<Plate>(scene.part).half_size_mm = 3;
    const Frame all = expose(*render(scene), scene, 1);
    Scene bare = scene;
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto effect = static_cast<Effect>(k);
        bare = without(bare, effect);
        // A stop and lenses that let all light through, and a well that is never full, change nothing here.
        if (effect == Effect::stop || effect == Effect::vignetting || effect == Effect::full_well) continue;
        const Scene less = without(scene, effect);
        const Frame frame = expose(*render(less), less, 1);
        EXPECT_NE(std::memcmp(all.bytes().data(), frame.bytes().data(), frame.bytes().size()), 0) << name_of(effect);
    }
    Scene plain = small(Plate{3, 4, 1.5}, 5);
    plain.camera.field_mm = 12;
    const LightField a = *render(bare), b = *render(plain);
    EXPECT_EQ(std::memcmp(a.bins.data(), b.bins.data(), a.bins.size() * sizeof(float)), 0);
}

}  // namespace
}  // namespace hord::lab
