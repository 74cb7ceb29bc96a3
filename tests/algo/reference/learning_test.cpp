// Learning a reference from good parts.
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/reference/clipped_noise.h"
#include "algo/reference/largest_by_part.h"
#include "algo/reference/read_noise.h"
#include "tests/algo/reference/good_parts.h"
#include "tests/support/light_image.h"

namespace hord::algo {
namespace {

using namespace testing;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Learning, names_the_parts_that_differ_from_all_others) {
    const auto speck = [](int m, int n, Spot& s) {
        if (std::hypot(m - 25, n - 20) < 2.5) s.light *= 0.4;
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 12; ++k)
        frames.push_back(seen(k == 4 ? part(wobble(k), speck) : k == 9 ? part({9, 3, 0}) : part(wobble(k)), k));
    const auto all = learn(frames.size(), [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_EQ(all->reference.parts, 10U);
    ASSERT_EQ(all->left_out.size(), 2U);
    EXPECT_EQ(all->left_out[0].part, 9U);  // it cannot be registered, which is checked first
    EXPECT_EQ(all->left_out[1].part, 4U);
    EXPECT_FALSE(all->poses[4]);
}

TEST(Learning, estimates_the_sensors_gain) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 12; ++k) frames.push_back(seen(part(wobble(k)), k));
    const auto all = learn(
        frames.size(), [&](std::size_t k) { return frames[k]; }, std::nullopt);
    ASSERT_TRUE(all);
    EXPECT_NEAR(all->reference.sensor.electrons_per_dn, 1, 0.2);
}

// 8 bits, 41.7 electrons a DN: rounding and ripple from lenslet to lenslet, another in every part, vary more than the
// photons do.
TEST(Learning, estimates_the_sensors_gain_whatever_else_varies) {
    constexpr double kGain = 41.7, kRipple = 0.015;
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) {
        std::mt19937_64 random(k);
        std::normal_distribution<double> ripple(1, kRipple);
        std::vector<double> gains(kField.lenslets());
        for (double& g : gains) g = ripple(random);
        const auto rippled = [&](int m, int n, Spot& s) { s.light *= gains[kField.index(m, n)]; };
        Frame wide = part(wobble(k), rippled);
        for (int y = 0; y < wide.height_px(); ++y) {
            for (int x = 0; x < wide.width_px(); ++x)
                wide.set(x, y, std::min(4095U, 2 * wide.view().sample(x, y)));  // brightest bin: 150 of 255 DN
        }
        frames.push_back(noisy(wide, {kGain / 16.06, 6, 1}, 100 + k, 8));  // electrons a DN of 12 bits
    }
    LearnOptions options;
    options.levels = light_levels({}, 8);
    options.read_dn = 0;
    const auto all = learn_reference(
        kField, 8, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_NEAR(static_cast<double>(all->reference.sensor.electrons_per_dn), kGain, 0.2 * kGain);
}

// 8 bits, 20 electrons a DN, 10 electrons of read noise: readings in dark bins move the reference's mean deflections
// more than photons do, and beside the middle bin of a spot there is little light. The part deflects no light.
TEST(Learning, estimates_the_sensors_gain_where_reading_is_much_of_the_noise) {
    constexpr double kGain = 20, kReadDn8 = 0.5;
    const auto narrow = [](int x, int y) {
        const int i = std::abs(x % 9 - 4), j = std::abs(y % 9 - 4), m = x / 9, n = y / 9;
        const double light = m > 10 && m < 30 && n > 10 && n < 28 ? 0.9 : 1;
        return light * (i + j == 0 ? 230.0 : i + j == 1 ? 12.5 : 0.0);
    };
    for (const double pedestal : {0.0, 3.0}) {
        std::vector<Frame> frames;
        for (std::uint64_t k = 0; k < 12; ++k) {
            std::mt19937_64 random(k + 1);
            std::normal_distribution<double> normal;
            Frame frame(kField.width_px(), kField.height_px(), 8);
            for (int y = 0; y < frame.height_px(); ++y) {
                for (int x = 0; x < frame.width_px(); ++x) {
                    const double light = narrow(x, y),
                                 v = light + std::hypot(std::sqrt(light / kGain), kReadDn8) * normal(random) + pedestal;
                    frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(v), 0L, 255L)));
                }
            }
            frames.push_back(std::move(frame));
        }
        LearnOptions options;
        options.levels = light_levels({}, 8);
        options.dark_from_noise = true;
        options.read_dn = kReadDn8;
        options.pedestal_dn = static_cast<float>(pedestal);
        const auto all = learn_reference(
            kField, 8, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
        ASSERT_TRUE(all) << all.error().message();
        EXPECT_FALSE(all->gain_unsure) << pedestal;
        EXPECT_NEAR(static_cast<double>(all->reference.sensor.electrons_per_dn), kGain, 0.2 * kGain) << pedestal;
    }
}

TEST(Learning, says_where_form_counts_as_noise) {
    std::vector<Frame> frames;  // deflections change everywhere, and no two parts have the same power
    const auto strip = [&](std::size_t k) {
        return drawn(kField, kBits, 1300, [&](int m, int n) {
            return Spot{(0.12 + 0.0005 * static_cast<double>(k)) * (m - 20), 0.08 * (n - 18), 1};
        });
    };
    for (std::size_t k = 0; k < 12; ++k) frames.push_back(seen(strip(k), k));
    const auto estimated = learn(
        frames.size(), [&](std::size_t k) { return frames[k]; }, std::nullopt);
    ASSERT_TRUE(estimated) << estimated.error().message();
    EXPECT_TRUE(estimated->gain_unsure);
    const auto given = learn(frames.size(), [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(given) << given.error().message();
    EXPECT_FALSE(given->gain_unsure);
    EXPECT_TRUE(learned().pose_determined[0] && learned().pose_determined[1] && learned().pose_determined[2]);
}

TEST(Learning, names_what_the_parts_do_not_determine) {
    Learned all;
    all.pose_determined = {true, true, true};
    EXPECT_TRUE(unsure_of(all, "", 6).empty());
    all.gain_unsure = true;
    all.pose_determined = {true, false, false};
    EXPECT_THAT(unsure_of(all, "give them", 6),
                ElementsAre(HasSubstr("several times too low: give them"),
                            HasSubstr("Pose not determined: the shift along y, the turn; ")));
}

TEST(Learning, says_where_frames_show_no_noise) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 12; ++k) frames.push_back(part(wobble(k)));
    LearnOptions options;
    options.levels = kLevels;
    options.read_dn = 0;
    const auto all = learn_reference(
        kField, kBits, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_THAT(unsure_of(*all, "give them", 6), Contains(HasSubstr("show no photon noise")));
    EXPECT_THAT(unsure_of(learned(), "give them", 6), Not(Contains(HasSubstr("show no photon noise"))));
}

// A normal variable above 2: by its distribution function, 0.02275, and its density, 0.05399.
TEST(Learning, knows_what_noise_leaves_above_the_dark_level) {
    const ClippedNoise above = clipped_noise(9, 6);
    EXPECT_NEAR(above.mean, 3 * (0.05399 - 2 * 0.02275), 1e-3);
    EXPECT_NEAR(above.variance, 9 * (5 * 0.02275 - 2 * 0.05399) - above.mean * above.mean, 1e-3);
}

// The default dark level, 48 DN at 12 bits, removes another share of every bin at another light. Counts the defects
// that are told inside good parts, two lenslets and more from the rim.
TEST(Learning, a_dark_level_by_the_noise_lets_the_light_change) {
    constexpr float kElectronsADn = 10;
    const auto exposed = [](std::uint64_t seed, double light) {
        return noisy(part(wobble(seed)), {kElectronsADn, kReadDn * kElectronsADn, light}, seed, kBits);
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(exposed(k, 1));
    const auto defects_told = [&](bool dark_from_noise, std::uint32_t dark_dn) {
        LearnOptions options;
        options.levels = light_levels({}, kBits);
        options.dark_from_noise = dark_from_noise;
        options.electrons_per_dn = kElectronsADn;
        options.read_dn = kReadDn;
        auto all = learn_reference(
            kField, kBits, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
        if (!all) throw std::runtime_error(all.error().message());
        Recipe recipe;
        recipe.reference = std::make_shared<Reference>(std::move(all->reference));
        EXPECT_EQ(light_levels(recipe, kBits).dark, dark_dn);
        int told = 0;
        for (const double light : {0.25, 0.5, 0.8}) {
            for (std::uint64_t seed = 100; seed < 110; ++seed) {
                for (const Defect& d : judge(exposed(seed, light), recipe).defects) {
                    const double x = static_cast<double>(d.m) - 0.5 * (kField.m - 1),
                                 y = static_cast<double>(d.n) - 0.5 * (kField.n - 1);
                    told += std::hypot(x / (kHalfM - 2), y / (kHalfN - 2)) < 1 ? 1 : 0;
                }
            }
        }
        return told;
    };
    EXPECT_EQ(defects_told(true, 4), 0);  // two standard deviations of 2 DN, less half a DN of rounding
    EXPECT_GT(defects_told(false, 48), 0);
}

// Three of the parts lack a quarter of the light in one lenslet, each in another one: as where an outline crosses.
TEST(Learning, what_several_parts_show_here_or_there_is_no_defect_there) {
    const auto dim_at = [](int m, int n) {
        return [m, n](int at_m, int at_n, Spot& s) {
            if (at_m == m && at_n == n) s.light *= 0.75;
        };
    };
    std::vector<Frame> frames;
    constexpr int kPlaces[3][2] = {{18, 17}, {22, 17}, {20, 21}};
    for (std::uint64_t k = 0; k < 16; ++k)
        frames.push_back(seen(k < 3 ? part({}, dim_at(kPlaces[k][0], kPlaces[k][1])) : part({}), k));
    auto all = learn(frames.size(), [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_TRUE(all->left_out.empty());
    Recipe with = recipe();
    with.reference = std::make_shared<Reference>(std::move(all->reference));
    EXPECT_EQ(judge(seen(part({}, dim_at(20, 18)), 100), with).verdict, Verdict::pass);
    EXPECT_EQ(judge(seen(part({}, dim_at(28, 18)), 101), with).verdict, Verdict::reject);
}

// Every part deflects otherwise in two lenslets of its rim, each part elsewhere along it.
TEST(Learning, what_parts_show_somewhere_at_the_rim_is_no_defect_at_the_rim) {
    const auto bent_at = [](int m, int n) {
        return [m, n](int at_m, int at_n, Spot& s) {
            if (at_m == m && at_n == n) s.x += 0.8;
        };
    };
    const auto along = [](double k) { return (k / 16 - 0.5) * 0.5 * std::numbers::pi; };  // its left and right
    const auto rim = [](double angle) {
        return std::pair(static_cast<int>(std::lround(0.5 * (kField.m - 1) + (kHalfM - 0.5) * std::cos(angle))),
                         static_cast<int>(std::lround(0.5 * (kField.n - 1) + (kHalfN - 0.5) * std::sin(angle))));
    };
    const auto with_two = [&](double angle) {
        return [&, angle](int at_m, int at_n, Spot& s) {
            for (const double a : {angle, angle + std::numbers::pi})
                bent_at(rim(a).first, rim(a).second)(at_m, at_n, s);
        };
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(seen(part({}, with_two(along(static_cast<double>(k)))), k));
    auto all = learn(frames.size(), [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_TRUE(all->left_out.empty());
    Recipe with = recipe();
    with.reference = std::make_shared<Reference>(std::move(all->reference));
    for (int k = 0; k < 16; ++k) {
        EXPECT_EQ(judge(seen(part({}, with_two(along(k + 0.5))), 100), with).verdict, Verdict::pass) << k;
    }
    EXPECT_EQ(judge(seen(part({}, bent_at(20, 18)), 101), with).verdict, Verdict::reject);
}

// Beside a dark bevel the reference expects light by where the part lies in a lenslet: of parts that lie almost alike,
// less than half show how far that is wrong.
TEST(Learning, good_plates_pass_where_parts_lie_almost_alike) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> shift(-0.1, 0.1), turn(-0.005, 0.005), tilt(-0.03, 0.03), place(-6, 6);
    const auto plate = [&](auto&&... opaque) {
        const Pose pose{shift(random), shift(random), turn(random)};
        const double x_bins = tilt(random), y_bins = tilt(random);
        return plate_with_dark_bevels(pose, x_bins, y_bins, opaque...);
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(seen(plate(), k));
    auto all = learn_plates(frames);
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_TRUE(all->left_out.empty());
    Recipe with = recipe();
    with.reference = std::make_shared<Reference>(std::move(all->reference));
    for (std::uint64_t k = 0; k < 12; ++k) {
        EXPECT_EQ(judge(seen(plate(), 100 + k), with).verdict, Verdict::pass) << k;
        const double at_x = place(random), at_y = place(random);
        const auto speck = [=](double x, double y) { return std::hypot(x - at_x, y - at_y) < 0.5; };
        EXPECT_EQ(judge(seen(plate(speck), 200 + k), with).verdict, Verdict::reject) << at_x << ", " << at_y;
    }
}

TEST(Learning, keeps_the_largest_values_one_of_each_part) {
    LargestByPart largest;
    for (const auto& [value, part] : {std::pair(3.0F, 1U), {5.0F, 2U}, {4.0F, 1U}, {1.0F, 3U}, {2.0F, 4U}, {-1.0F, 5U}})
        largest.add(value, part);
    EXPECT_EQ(largest.value(0), 5);
    EXPECT_EQ(largest.value(1), 4);
    EXPECT_EQ(largest.value(2), 2);
    EXPECT_EQ(largest.part(1), 1U);
    EXPECT_EQ(largest.second_without(9), 4);
    EXPECT_EQ(largest.second_without(2), 2);
    LargestByPart more;
    more.add(6, 1);
    more.add(largest);
    EXPECT_EQ(more.value(0), 6);
    EXPECT_EQ(more.value(1), 5);
    EXPECT_EQ(more.value(2), 2);
}

TEST(Learning, single_readings_far_from_all_light_leave_nothing_in_the_reference_hords) {
    const Reference& r = learned().reference;
    int valid = 0, far_light = 0, without_light = 0;
    for (std::size_t k = 0; k < r.mask.size(); ++k) {
        if (r.mask[k] != kValid) continue;
        ++valid;
        int lit = 0, far = 0;
        for (int j = 0; j < 9; ++j) {
            for (int i = 0; i < 9; ++i) {
                if (r.shares[k * r.stride() + r.place(i, j)] == 0) continue;
                ++lit;
                far += std::hypot(i - 4 - static_cast<double>(r.x[k]), j - 4 - static_cast<double>(r.y[k])) > 4 ? 1 : 0;
            }
        }
        far_light += far > 0 ? 1 : 0;
        without_light += lit < 2 ? 1 : 0;
    }
    EXPECT_GT(valid, 500);
    EXPECT_EQ(without_light, 0);
    EXPECT_LT(far_light, valid / 50);  // without their removal: 30 %
}

TEST(Learning, tells_the_read_noise_from_the_bins_without_light) {
    const auto told = [](const Frame& frame, const LightLevels& levels) {
        return read_noise_of(kField, levels, 4, [&](std::size_t) -> Result<Frame> { return frame; });
    };
    const Frame clean = part({});
    for (const double electrons : {0.0, 1.0, 2.0, 4.0}) {
        const auto read = told(noisy(clean, {1, electrons, 1}, 7, kBits), kLevels);
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_NEAR(*read, electrons, 0.1 * electrons) << electrons;
    }
    // 8 bits: noise is less than a DN and values below 0 are clipped.
    const Frame coarse = drawn(kField, 8, 150, [](int, int) { return Spot{0.3, -0.4, 0.9}; });
    for (const double dn : {0.4, 0.6, 1.0}) {
        const auto read = told(noisy(coarse, {10, 10 * dn, 1}, 8), {3, 20, 255});
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_NEAR(*read, dn, 0.1 * dn);
    }
    // Light everywhere: there are no dark bins.
    Frame bright = clean;
    for (int y = 0; y < bright.height_px(); ++y) {
        for (int x = 0; x < bright.width_px(); ++x) bright.set(x, y, 1000);
    }
    const auto none = told(bright, kLevels);
    ASSERT_FALSE(none);
    EXPECT_NE(none.error().cure.find("--read-dn"), std::string::npos);
}

// A square lenslet diffracts along the rows and columns of its bins, differently as its spot lies.
TEST(Learning, takes_no_diffracted_light_for_read_noise) {
    Frame clean = part({});
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            for (int k = 0; k < 9; ++k) {
                const int x = m * 9 + k, row = n * 9 + 4, y = n * 9 + k, column = m * 9 + 4;
                const auto light = static_cast<std::uint32_t>(3 + (m + n) % 12);  // DN
                clean.set(x, row, clean.view().sample(x, row) + light);
                if (k != 4) clean.set(column, y, clean.view().sample(column, y) + light);
            }
        }
    }
    const auto read = read_noise_of(kField, kLevels, 4, [&](std::size_t k) -> Result<Frame> {
        return noisy(clean, {1, 2, 1}, k, kBits);
    });
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_NEAR(*read, 2, 0.2);
}

TEST(Learning, needs_eight_parts_that_lie_alike) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 9; ++k) frames.push_back(seen(k < 7 ? part(wobble(k)) : part({8, 8, 0}), k));
    const auto few = learn(7, [&](std::size_t k) { return frames[k]; });
    ASSERT_FALSE(few);
    const auto strangers = learn(9, [&](std::size_t k) { return frames[k]; });
    ASSERT_FALSE(strangers);
    EXPECT_NE(strangers.error().what.find("part 8"), std::string::npos) << strangers.error().what;
}

TEST(Learning, the_same_frames_give_the_same_reference) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 8; ++k) frames.push_back(seen(part(wobble(k)), k));
    const auto a = learn(8, [&](std::size_t k) { return frames[k]; }),
               b = learn(8, [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->reference.shares, b->reference.shares);
    EXPECT_EQ(a->reference.spread, b->reference.spread);
    EXPECT_TRUE(check(a->reference));
}

// A camera without pedestal: learning and inspection must subtract the same level.
TEST(Learning, from_a_quiet_sensor_without_pedestal_gives_a_reference_that_good_parts_pass) {
    LearnOptions options;
    options.levels = light_levels(Recipe{}, kBits);
    options.dark_from_noise = true;
    options.electrons_per_dn = 10 * 255.0F / 4095;
    options.read_dn = 1.5F;
    // Round spots: there is faint light beside them.
    const LightImage light = spots(kField, 200, 0.7, lens(kField, 14, 1.5));
    const auto frame = [&](std::uint64_t k) { return exposed(light, {0, 1.5 * 255 / 4095}, k, kBits); };
    const auto learned = learn_reference(
        kField, kBits, 12, [&](std::size_t k) -> Result<Frame> { return frame(k); }, options);
    ASSERT_TRUE(learned) << learned.error().message();
    Recipe r;
    r.reference = std::make_shared<Reference>(learned->reference);
    for (std::uint64_t k = 20; k < 26; ++k) EXPECT_EQ(judge(frame(k), r).verdict, Verdict::pass) << k;
}

}  // namespace
}  // namespace hord::algo
