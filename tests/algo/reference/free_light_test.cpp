// Is a frame's light rather an empty field's than that of a reference's part?
#include "algo/reference/free_light.h"

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr Extents kField{55, 51, 9, 9}, kLargeField{111, 111, 9, 9};
constexpr std::uint32_t kParts = 20;
constexpr double kElectrons = 4000;  // a lenslet of free light, in full light; a DN each
constexpr int kSeeds = 40;

// The light of a lenslet over the free light.
using Light = std::function<double(int m, int n)>;
double empty(int, int) { return 1; }
double plate(int m, int n) { return m >= 10 && m < 44 && n >= 12 && n < 38 ? 0.92 : 1; }
double half_plate(int m, int n) { return m < 27 ? plate(m, n) : 1; }
double web(int, int) { return 0.92; }

// Photon noise, and ripple of 1 % that is another in each part.
double noisy(double share, double electrons, std::mt19937_64& random) {
    const double mean = share * electrons;
    return mean * (1 + 0.01 * std::normal_distribution()(random)) +
        std::sqrt(mean) * std::normal_distribution()(random);
}

// A smooth pattern of light over the field, of about 1 % standard deviation: a wave with another phase a part.
Light smooth(double phase) {
    return [phase](int m, int n) { return 0.9 * (1 + 0.014 * std::sin(0.11 * m + 0.07 * n + phase)); };
}

// How many of kSeeds frames of `frame` in `level` of the light are refused against a reference of kParts of `learned`.
int refused(const Light& learned, const Light& frame, double level, const Extents& field = kField) {
    int count = 0;
    for (int seed = 0; seed < kSeeds; ++seed) {
        std::mt19937_64 random(5400 + static_cast<std::uint64_t>(seed));
        std::vector<float> light(field.lenslets());
        std::vector<std::uint32_t> sums(field.lenslets());
        const std::vector<std::uint8_t> mask(field.lenslets(), kValid);
        for (int n = 0; n < field.n; ++n) {
            for (int m = 0; m < field.m; ++m) {
                double sum = 0;
                for (std::uint32_t part = 0; part < kParts; ++part) sum += noisy(learned(m, n), kElectrons, random);
                light[field.index(m, n)] = static_cast<float>(sum / kParts);
                sums[field.index(m, n)] =
                    static_cast<std::uint32_t>(std::lround(noisy(frame(m, n), level * kElectrons, random)));
            }
        }
        const ReferenceMaps reference{light, {}, {}, mask};
        count += is_rather_empty(field, reference, {{}, sums, mask}, PoseMap({0.3, -0.2, 0.002}, field), 1, kParts);
    }
    return count;
}

TEST(FreeLight, of_a_clear_plate_is_told_in_any_light) {
    for (const double level : {1.0, 0.5, 0.25, 0.1}) {
        EXPECT_EQ(refused(plate, empty, level), kSeeds) << level;
        EXPECT_EQ(refused(plate, half_plate, level), kSeeds) << level;
    }
}

TEST(FreeLight, is_not_seen_in_good_parts) {
    for (const double level : {1.0, 0.5, 0.25, 0.1}) EXPECT_EQ(refused(plate, plate, level), 0) << level;
}

// Its reference varies by noise alone, which no frame repeats.
TEST(FreeLight, is_not_told_where_the_light_does_not_vary) {
    for (const double level : {1.0, 0.25}) {
        EXPECT_EQ(refused(web, web, level), 0) << level;
        EXPECT_EQ(refused(empty, empty, level), 0) << level;
        EXPECT_EQ(refused(web, web, level, kLargeField), 0) << "enough lenslets to be certain of noise";
    }
}

// What is alike in all parts is as large as what differs from part to part.
TEST(FreeLight, is_not_told_where_good_parts_differ_smoothly) {
    const auto learned = [](int m, int n) {
        return 1 + 0.01 * std::sin(0.05 * (m - n)) + (smooth(1.0)(m, n) - 0.9) / 4;
    };
    for (const double phase : {0.0, 1.0, 2.0, 3.0, 4.0, 5.0}) {
        const Light other = smooth(phase);
        const auto frame = [&](int m, int n) { return 1 + 0.01 * std::sin(0.05 * (m - n)) + other(m, n) - 0.9; };
        EXPECT_EQ(refused(learned, frame, 1), 0) << phase;
    }
}

TEST(FreeLight, a_part_of_another_tint_is_no_empty_field) {
    const auto tinted = [](int m, int n) { return plate(m, n) < 1 ? 0.85 : 1; };
    const auto clearer = [](int m, int n) { return plate(m, n) < 1 ? 0.94 : 1; };
    EXPECT_EQ(refused(plate, tinted, 1), 0);
    EXPECT_EQ(refused(plate, clearer, 1), 0);
}

}  // namespace
}  // namespace hord::algo
