#include "hal_sim/optics/scene/noise.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "hal_sim/optics/camera/render.h"

namespace hord::sim {
namespace {

TEST(Noise, philox_gives_the_published_answers) {  // Random123, kat_vectors
    std::uint32_t zero[4] = {};
    const std::uint32_t zero_key[2] = {};
    philox(zero, zero_key);
    EXPECT_EQ(zero[0], 0x6627e8d5U);
    EXPECT_EQ(zero[1], 0xe169c58dU);
    EXPECT_EQ(zero[2], 0xbc57ac4cU);
    EXPECT_EQ(zero[3], 0x9b00dbd8U);
    std::uint32_t ones[4] = {~0U, ~0U, ~0U, ~0U};
    const std::uint32_t ones_key[2] = {~0U, ~0U};
    philox(ones, ones_key);
    EXPECT_EQ(ones[0], 0x408f276dU);
    EXPECT_EQ(ones[1], 0x41c83b0eU);
    EXPECT_EQ(ones[2], 0xa20bc7c6U);
    EXPECT_EQ(ones[3], 0x6d5451fdU);
}

struct Moments {
    double mean = 0, variance = 0;
};
template <class Draw>
Moments moments(int count, const Draw& draw) {
    std::vector<double> x;
    for (int k = 0; k < count; ++k) x.push_back(draw(static_cast<std::uint64_t>(k)));
    Moments m;
    for (const double v : x) m.mean += v / count;
    for (const double v : x) m.variance += (v - m.mean) * (v - m.mean) / count;
    return m;
}

constexpr int kDraws = 200'000;
constexpr double kSigmas = 5;  // standard errors of the estimate; one draw with a fixed seed

TEST(Noise, poisson_has_its_mean_as_variance_on_both_sides_of_the_change_of_method) {
    for (const double mean : {0.01, 0.3, 4.0, 9.99, 10.0, 25.0, 240.0, 20'000.0, 3e6}) {
        const Moments m =
            moments(kDraws, [&](std::uint64_t k) { return static_cast<double>(Noise(11, k).poisson(mean)); });
        EXPECT_NEAR(m.mean, mean, kSigmas * std::sqrt(mean / kDraws)) << mean;
        EXPECT_NEAR(m.variance, mean, kSigmas * std::sqrt((mean + 2 * mean * mean) / kDraws)) << mean;
    }
    EXPECT_EQ(Noise(1, 1).poisson(0), 0U);
}

TEST(Noise, poisson_counts_follow_the_distribution) {
    for (const double mean : {3.0, 14.0}) {
        std::vector<double> seen(60);
        for (std::uint64_t k = 0; k < kDraws; ++k) seen[std::min<std::size_t>(Noise(5, k).poisson(mean), 59)] += 1;
        double chi2 = 0, p = std::exp(-mean);
        int cells = 0;
        for (int k = 0; k < 59; ++k, p *= mean / k) {
            if (p * kDraws < 20) continue;
            chi2 += (seen[static_cast<std::size_t>(k)] - p * kDraws) *
                (seen[static_cast<std::size_t>(k)] - p * kDraws) / (p * kDraws);
            ++cells;
        }
        EXPECT_LT(chi2, cells + kSigmas * std::sqrt(2.0 * cells)) << mean;
    }
}

TEST(Noise, normal_has_the_moments_and_tails_of_a_normal) {
    const Moments m = moments(kDraws, [](std::uint64_t k) { return Noise(3, k).normal(); });
    EXPECT_NEAR(m.mean, 0, kSigmas / std::sqrt(kDraws));
    EXPECT_NEAR(m.variance, 1, kSigmas * std::sqrt(2.0 / kDraws));
    const Moments fourth = moments(kDraws, [](std::uint64_t k) { return std::pow(Noise(3, k).normal(), 4); });
    EXPECT_NEAR(fourth.mean, 3, kSigmas * std::sqrt(96.0 / kDraws));
    const Moments far = moments(kDraws, [](std::uint64_t k) { return std::abs(Noise(3, k).normal()) > 3 ? 1.0 : 0.0; });
    EXPECT_NEAR(far.mean, 0.0026998, kSigmas * std::sqrt(0.0027 / kDraws));
}

LightField even_light(float value) {
    const algo::Extents e{40, 40, 9, 9};
    return {e, std::vector<float>(e.lenslets() * 81, value)};
}

TEST(Exposure, without_noise_scales_rounds_and_saturates) {
    Scene scene;
    scene.camera.full_bin_dn = 240;
    EXPECT_EQ(expose(even_light(1.0F), scene, 1).view().sample(3, 5), 240U);
    EXPECT_EQ(expose(even_light(0.5F), scene, 1, 0.5).view().sample(3, 5), 60U);
    EXPECT_EQ(expose(even_light(2.0F), scene, 1).view().sample(3, 5), 255U);
    scene.noise.dark_dn = 7;
    EXPECT_EQ(expose(even_light(1.0F), scene, 1, 0).view().sample(0, 0), 7U);
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = 4000;
    EXPECT_EQ(expose(even_light(0.25F), scene, 1).view().sample(359, 359), 1007U);
}

TEST(Exposure, noise_has_the_variance_of_photons_reading_and_rounding) {
    Scene scene;
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = 1000;
    scene.noise = {.electrons_per_dn = 4, .read_e = 6, .dark_dn = 100};
    const Frame frame = expose(even_light(0.5F), scene, 99);
    const int count = frame.width_px() * frame.height_px();
    const Moments m = moments(count, [&](std::uint64_t k) {
        return static_cast<double>(
            frame.view().sample(static_cast<int>(k) % frame.width_px(), static_cast<int>(k) / frame.width_px()));
    });
    const double variance = (500 * 4.0 + 36) / 16 + 1.0 / 12;
    EXPECT_NEAR(m.mean, 600, kSigmas * std::sqrt(variance / count));
    EXPECT_NEAR(m.variance, variance, kSigmas * variance * std::sqrt(2.0 / count));
}

std::uint64_t checksum(const Frame& frame) {  // FNV-1a
    std::uint64_t sum = 0xcbf29ce484222325ULL;
    for (const std::byte b : frame.bytes()) sum = (sum ^ static_cast<std::uint64_t>(b)) * 0x100000001b3ULL;
    return sum;
}

TEST(Exposure, a_seed_gives_the_same_bits_everywhere_and_another_gives_others) {
    Scene scene;
    scene.noise = {.electrons_per_dn = 10, .read_e = 2, .dark_dn = 4};
    LightField field = even_light(0);
    for (std::size_t k = 0; k < field.bins.size(); ++k) field.bins[k] = static_cast<float>(k % 97) / 128.0F;
    EXPECT_EQ(checksum(expose(field, scene, 42)), checksum(expose(field, scene, 42)));
    EXPECT_NE(checksum(expose(field, scene, 42)), checksum(expose(field, scene, 43)));
    EXPECT_EQ(checksum(expose(field, scene, 42)), 7192827820713476290ULL);  // x86-64, arm64
}

}  // namespace
}  // namespace hord::sim
