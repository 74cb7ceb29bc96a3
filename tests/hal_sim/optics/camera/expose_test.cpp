// The sensor (EMVA 1288).
#include <cmath>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

#include "hal_sim/optics/camera/render.h"

namespace hord::sim {
namespace {

struct Moments {
    double mean = 0, variance = 0;
};
template <class At>
Moments moments(const Frame& frame, const At& at) {
    Moments m;
    const double count = static_cast<double>(frame.width_px()) * frame.height_px();
    for (int pass = 0; pass < 2; ++pass) {
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x) {
                if (pass == 0) m.mean += at(x, y) / count;
                else m.variance += (at(x, y) - m.mean) * (at(x, y) - m.mean) / count;
            }
        }
    }
    return m;
}
Moments moments(const Frame& frame) {
    return moments(frame, [&](int x, int y) { return static_cast<double>(frame.view().sample(x, y)); });
}
constexpr double kSigmas = 5;
constexpr int kPixels = 360 * 360;

Frame even(const Scene& scene, float level, std::uint64_t seed) {
    const std::vector<float> light(kPixels, level);
    return expose(light, 360, 360, scene, seed);
}

TEST(Sensor, dark_current_adds_its_electrons_and_their_shot_noise) {
    Scene scene;
    scene.camera.bits = 16;
    scene.noise = {.electrons_per_dn = 0.5, .dark_dn = 10, .dark_e_per_s = 4000, .exposure_ms = 25};
    const Moments m = moments(even(scene, 0, 3));
    EXPECT_NEAR(m.mean, 10 + 100 / 0.5, kSigmas * std::sqrt(100 / 0.25 / kPixels));
    EXPECT_NEAR(m.variance, 100 / 0.25 + 1.0 / 12, kSigmas * 400 * std::sqrt(2.0 / kPixels));
}

TEST(Sensor, pixels_without_light_are_drawn_unless_no_noise_can_change_them) {
    constexpr float kHardlyAny = 1e-30F;
    Scene scene;
    const SensorNoise kinds[] = {
        {.electrons_per_dn = 40, .read_e = 2, .dark_dn = 1},
        {.electrons_per_dn = 40, .read_e = 2.3, .dark_dn = 1},
        {.electrons_per_dn = 40, .read_e = 2.5, .dark_dn = 1},  // may reach the next sample, once in 10^15 pixels
        {.electrons_per_dn = 40, .read_e = 2, .dark_dn = 1.02, .dsnu_e = 0.3},
        {.electrons_per_dn = 4, .read_e = 8, .dark_dn = 20},
        {.dark_dn = 7.49},
    };
    for (const SensorNoise& noise : kinds) {
        scene.noise = noise;
        const Frame dark = even(scene, 0, 1), drawn = even(scene, kHardlyAny, 1);
        const bool varies = moments(drawn).variance > 1e-6;
        EXPECT_EQ(varies, noise.read_e == 8);
        EXPECT_EQ(varies, moments(dark).variance > 1e-6);
        EXPECT_TRUE(varies || std::memcmp(dark.bytes().data(), drawn.bytes().data(), dark.bytes().size()) == 0);
    }
}

TEST(Sensor, prnu_is_a_pattern_of_the_camera_and_grows_with_the_light) {
    Scene scene;
    scene.camera.bits = 16;
    scene.camera.full_bin_dn = 40000;
    scene.noise.prnu = 0.01;
    for (const double level : {0.25, 1.0}) {
        const Moments m = moments(even(scene, static_cast<float>(level), 1));
        EXPECT_NEAR(std::sqrt(m.variance), 400 * level, 400 * level * kSigmas / std::sqrt(2.0 * kPixels));
    }
    const Frame one = even(scene, 1, 1), other = even(scene, 1, 2);
    EXPECT_EQ(std::memcmp(one.bytes().data(), other.bytes().data(), one.bytes().size()), 0);  // for every frame
    scene.noise.pattern_seed = 2;                                                             // another camera
    const Frame third = even(scene, 1, 1);
    const Moments both = moments(one, [&](int x, int y) {
        return static_cast<double>(one.view().sample(x, y)) - static_cast<double>(third.view().sample(x, y));
    });
    EXPECT_NEAR(std::sqrt(both.variance), 400 * std::sqrt(2.0), 10);
}

TEST(Sensor, dsnu_is_a_pattern_that_light_does_not_change) {
    Scene scene;
    scene.camera.bits = 16;
    scene.noise = {.electrons_per_dn = 0.1, .dark_dn = 1000, .dsnu_e = 5, .photon_noise = false};
    const Frame dark = even(scene, 0, 1), lit = even(scene, 0.5F, 2);
    const Moments d = moments(dark), difference = moments(dark, [&](int x, int y) {
                                         return static_cast<double>(lit.view().sample(x, y)) -
                                             static_cast<double>(dark.view().sample(x, y));
                                     });
    EXPECT_NEAR(std::sqrt(d.variance), 50, 50 * kSigmas / std::sqrt(2.0 * kPixels));
    EXPECT_NEAR(difference.mean, 120, 1e-9);
    EXPECT_LT(difference.variance, 1e-9);
}

TEST(Sensor, a_full_well_holds_no_more) {
    Scene scene;
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = 4000;
    scene.noise = {.electrons_per_dn = 4, .full_well_e = 8000};
    EXPECT_NEAR(moments(even(scene, 0.4F, 1)).mean, 1600, 1);
    const Moments m = moments(even(scene, 0.9F, 1));
    EXPECT_NEAR(m.mean, 2000, 1e-6);
    EXPECT_LT(m.variance, 1e-9);
}

TEST(Sensor, without_photon_noise_counts_electrons_exactly) {
    Scene scene;
    scene.noise = {.electrons_per_dn = 4, .photon_noise = false};
    EXPECT_LT(moments(even(scene, 0.5F, 1)).variance, 1e-9);
}

}  // namespace
}  // namespace hord::sim
