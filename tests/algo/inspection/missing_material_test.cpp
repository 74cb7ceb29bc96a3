// Places of a part through which light passes as if there were no material: drawn light, and whole verdicts.
#include "algo/inspection/missing_material.h"

#include <cmath>
#include <cstdlib>
#include <functional>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "tests/support/counted_heap.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{61, 61, 9, 9};
constexpr std::uint32_t kLight = 10'000;

// A part within `from`..`to` lenslets of each axis; light relative to that of the part.
struct Field {
    std::vector<std::uint32_t> sums = std::vector<std::uint32_t>(kField.lenslets());
    std::vector<std::uint8_t> mask = std::vector<std::uint8_t>(kField.lenslets(), kValid);
};

Field field(const std::function<double(int m, int n)>& light, int from = 0, int to = 60) {
    Field f;
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            // +- 1 %, the same for each run, without a period
            const double noise = 0.02 * (std::fmod(0.6180339887 * (m * 7919 + n * 104'729), 1.0) - 0.5);
            f.sums[kField.index(m, n)] = static_cast<std::uint32_t>(kLight * light(m, n) * (1 + noise));
            if (m < from || m > to || n < from || n > to) f.mask[kField.index(m, n)] = kOutside;
        }
    }
    return f;
}

std::function<double(int, int)> hole(double m, double n, double radius, double light) {
    return [=](int x, int y) { return std::hypot(x - m, y - n) <= radius ? light : 1; };
}

std::optional<MissingMaterial> found_in(const Field& f, std::uint32_t min_area = 1, PartForm form = PartForm::round,
                                        float light_beside = 0) {
    MissingMaterialFinder finder(kField, form);
    return finder.find(f.sums, f.mask, {.min_area = min_area, .light_beside = light_beside});
}

std::optional<MissingMaterial> found_in_web(const std::function<double(int m, int n)>& light) {
    return found_in(field(light), 1, PartForm::web);
}

TEST(MissingMaterial, is_a_hole_of_any_size_whose_light_is_that_of_no_glass) {
    for (const double radius : {2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 11.0, 15.0, 20.0}) {
        const auto found = found_in(field(hole(33, 27, radius, 1.08)));
        ASSERT_TRUE(found) << radius;
        EXPECT_LE(std::hypot(found->m - 33, found->n - 27), radius) << radius;
        EXPECT_LE(found->length, 2 * radius + 1) << radius;
        EXPECT_NEAR(found->excess, 0.08, 0.03) << radius;
    }
}

TEST(MissingMaterial, is_a_single_lenslet_of_a_dark_part) {
    const auto found = found_in(field(hole(12, 40, 0.5, 1.6)));
    ASSERT_TRUE(found);
    EXPECT_EQ(found->m, 12);
    EXPECT_EQ(found->n, 40);
    EXPECT_EQ(found->area, 1U);
    EXPECT_GT(found->score, 1);
}

// Of little light in whole numbers: a difference of two lenslets is 0, 1, 2, ... of 268.
TEST(MissingMaterial, is_no_lenslet_within_five_deviations_of_little_light) {
    constexpr int kLittle = 268;
    constexpr double kDeviation = 2.8;  // of one lenslet
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        std::mt19937_64 random(seed);
        std::normal_distribution<double> noise(0, kDeviation);
        Field f = field([](int, int) { return 1; });
        for (std::uint32_t& sum : f.sums) sum = static_cast<std::uint32_t>(std::lround(kLittle + noise(random)));
        const auto set = [&](double sum) {
            for (const auto& [m, n] : {std::pair(18, 30), std::pair(22, 30), std::pair(20, 28), std::pair(20, 32)})
                f.sums[kField.index(m, n)] = kLittle;
            f.sums[kField.index(20, 30)] = static_cast<std::uint32_t>(std::lround(sum));
        };
        const double five = 5 * std::sqrt(2.0) * kDeviation;
        set(kLittle + 0.9 * five);
        EXPECT_FALSE(found_in(f)) << seed;
        set(kLittle + 1.6 * five);
        EXPECT_TRUE(found_in(f)) << seed;
    }
}

// Of a part of 21 x 21 lenslets whose light has noise of so much; with a hole of 12 lenslets in it, or without.
Field small_plate(double noise, std::uint64_t seed, bool has_hole) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal(1, noise);
    Field f = field(hole(30, 30, has_hole ? 6 : -1, 1.087), 20, 40);
    for (std::uint32_t& sum : f.sums) sum = static_cast<std::uint32_t>(std::lround(sum * normal(random)));
    return f;
}

// Most pairs of its squares lie across the outline: they are no noise. At 2 % the hole's 8 % are five deviations of
// squares of 3 x 3, so that noise hides some.
TEST(MissingMaterial, is_a_hole_of_more_than_half_the_width_of_the_part) {
    for (const auto& [noise, least] : {std::pair(0.005, 20), std::pair(0.01, 20), std::pair(0.02, 16)}) {
        int holes = 0;
        for (std::uint64_t seed = 1; seed <= 20; ++seed) {
            const auto found = found_in(small_plate(noise, seed, true), 1, PartForm::plate);
            if (!found) continue;
            ++holes;
            EXPECT_LE(std::hypot(found->m - 30, found->n - 30), 3) << noise << " " << seed;
        }
        EXPECT_GE(holes, least) << noise;
    }
}

// Of a part of 16 x 16 lenslets whose light has noise of 2 % a lenslet, 3 x 3 squares that lie apart from the outline
// of a hole of twelve are too few to estimate their noise: what a lamp does not explain is a hole.
TEST(MissingMaterial, is_a_hole_beside_whose_outline_a_small_part_leaves_little) {
    const auto found_of = [](const std::function<double(int m, int n)>& light, std::uint64_t seed) {
        std::mt19937_64 random(seed);
        std::normal_distribution<double> normal(1, 0.02);
        Field f = field(light, 22, 37);
        for (std::uint32_t& sum : f.sums) sum = static_cast<std::uint32_t>(std::lround(sum * normal(random)));
        return found_in(f, 1, PartForm::plate);
    };
    const auto lamp = [](double height, double width) {
        return [=](int m, int n) {
            const double x = m - 29, y = n - 30;
            return 1 + height * std::exp(-(x * x + y * y) / (2 * width * width));
        };
    };
    int holes = 0;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        holes += found_of(hole(29.5, 29.5, 6, 1.15), seed) ? 1 : 0;
        for (const double height : {-0.2, 0.1, 0.2}) {
            for (const double width : {6.0, 9.0}) EXPECT_FALSE(found_of(lamp(height, width), seed)) << height << seed;
        }
    }
    EXPECT_EQ(holes, 20);
}

TEST(MissingMaterial, is_none_by_noise_alone_in_a_small_part) {
    for (const double noise : {0.005, 0.01, 0.02, 0.04, 0.08}) {
        for (std::uint64_t seed = 1; seed <= 60; ++seed) {
            for (const PartForm form : {PartForm::round, PartForm::plate, PartForm::tube})
                EXPECT_FALSE(found_in(small_plate(noise, seed, false), 1, form)) << noise << " " << seed;
        }
    }
}

TEST(MissingMaterial, is_a_notch_that_is_open_at_one_side) {
    const auto found = found_in(field(hole(10, 30, 6, 1.08), 10, 50));
    ASSERT_TRUE(found);
    EXPECT_LE(std::hypot(found->m - 10, found->n - 30), 6);
}

TEST(MissingMaterial, is_a_slit_that_ends_in_the_field_in_any_direction) {
    for (const double angle : {0.0, 0.4, 0.785, 1.3, 1.571}) {
        for (const double width : {4.0, 8.0}) {
            const auto slit = [=](int m, int n) {
                const double along = (m - 30) * std::cos(angle) + (n - 30) * std::sin(angle),
                             across = (n - 30) * std::cos(angle) - (m - 30) * std::sin(angle);
                return std::abs(across) <= width / 2 && along < 8 ? 1.08 : 1;
            };
            EXPECT_TRUE(found_in_web(slit)) << angle << ", " << width;
            EXPECT_TRUE(found_in(field(slit, 6, 54), 1, PartForm::plate)) << angle << ", " << width;
        }
    }
}

TEST(MissingMaterial, is_what_is_torn_off_a_web) {
    for (const double angle : {0.0, 0.3, 0.785, 2.0, 4.0}) {
        for (const double from : {-8.0, 0.0, 12.0}) {
            const auto torn = [=](int m, int n) {
                const double across = (m - 30) * std::cos(angle) + (n - 30) * std::sin(angle),
                             along = (n - 30) * std::cos(angle) - (m - 30) * std::sin(angle);
                return across > from + 2.5 * std::sin(along / 3) ? 1.08 : 1;
            };
            const auto found = found_in_web(torn);
            ASSERT_TRUE(found) << angle << ", " << from;
            EXPECT_GT(torn(static_cast<int>(found->m), static_cast<int>(found->n)), 1) << angle << ", " << from;
        }
    }
}

TEST(MissingMaterial, is_film_with_a_hole_every_few_lenslets) {
    for (const int period : {10, 14, 20}) {
        EXPECT_TRUE(found_in_web([=](int m, int n) {
            return std::hypot(m % period - period / 2, n % period - period / 2) < 0.25 * period ? 1.2 : 1;
        })) << period;
    }
}

TEST(MissingMaterial, is_the_bright_side_and_never_a_stain_in_the_field) {
    for (const double radius : {3.0, 8.0, 15.0}) EXPECT_FALSE(found_in_web(hole(30, 30, radius, 0.9))) << radius;
}

TEST(MissingMaterial, is_none_where_light_changes_smoothly_or_the_rim_is_dark_or_light_is_missing) {
    const auto none = [](const std::function<double(int, int)>& light, const char* what) {
        for (const PartForm form : {PartForm::round, PartForm::plate, PartForm::tube})
            EXPECT_FALSE(found_in(field(light, 8, 52), 1, form)) << what << ", " << static_cast<int>(form);
    };
    const auto none_in_web = [&](const std::function<double(int, int)>& light, const char* what) {
        none(light, what);
        EXPECT_FALSE(found_in_web(light)) << what << ", web";
    };
    none_in_web([](int, int) { return 1.0; }, "even");
    none_in_web([](int m, int) { return 1 + 0.02 * m; }, "a slope");
    none_in_web([](int m, int n) { return 1 + 0.3 * std::exp(-(std::pow(m - 30, 2) + std::pow(n - 30, 2)) / 800); },
                "a lens");
    none_in_web([](int m, int n) { return 1 + 0.1 * std::sin(m / 1.5) * std::sin(n / 1.5); }, "ripple");
    none_in_web([](int m, int n) { return 1 + 0.1 * std::sin(m / 6.0) * std::sin(n / 6.0); }, "wide ripple");
    none_in_web([](int m, int n) { return 1 - 0.3 * std::exp(-std::pow(m - n - 3, 2) / 4.0); }, "a dark line");
    none([](int m, int n) { return m < 12 || m > 48 || n < 12 || n > 48 ? 0.8 : 1; }, "a dark rim");
    none([](int m, int) { return m < 30 ? 1.0 : 1.3; }, "a step");
    none_in_web(hole(30, 30, 6, 0.8), "a dark place");
}

// At 1,000 electrons a lenslet only large squares show 6 %, and ten lenslets do not tell a step from a lamp.
TEST(MissingMaterial, is_no_ridge_and_no_bow_of_a_webs_light_that_noise_makes_a_step) {
    std::mt19937 random(1);
    const auto noisy = [&](const std::function<double(int, int)>& light) {
        Field f = field(light);
        for (std::uint32_t& sum : f.sums)
            sum = static_cast<std::uint32_t>(sum * std::normal_distribution(1.0, 0.03)(random));
        return found_in(f, 1, PartForm::web).has_value();
    };
    for (int k = 0; k < 20; ++k) {
        EXPECT_FALSE(noisy([](int m, int) { return 1 - 0.08 * std::pow((m - 30) / 30.0, 2); })) << "a bow";
        EXPECT_FALSE(noisy([](int m, int) { return 1 + 0.06 * std::exp(-std::pow((m - 30) / 6.0, 2) / 2); }))
            << "a ridge";
        EXPECT_TRUE(noisy([](int m, int n) { return std::hypot(m - 33, n - 27) < 9 ? 1.3 : 1; }));
    }
}

TEST(MissingMaterial, of_a_tube_is_no_line_of_light_along_its_wall) {
    for (const int half_width : {0, 1}) {
        const auto line = [=](int m, int) { return std::abs(m - 40) <= half_width ? 1.05 : 1; };
        EXPECT_FALSE(found_in(field(line), 1, PartForm::tube)) << half_width;
    }
    const auto piece = [=](int m, int n) { return m == 40 && n > 20 ? 1.05 : 1; };
    EXPECT_FALSE(found_in(field(piece), 1, PartForm::tube));
    EXPECT_TRUE(found_in(field(hole(30, 30, 4, 1.08)), 1, PartForm::tube));
}

TEST(MissingMaterial, beside_the_part_is_none) {
    EXPECT_FALSE(found_in(field([](int m, int n) { return m < 8 || n < 8 || m > 52 || n > 52 ? 1.08 : 1; }, 8, 52)));
}

TEST(MissingMaterial, counts_saturated_lenslets_and_not_dark_ones) {
    Field f = field(hole(30, 30, 4, 1.3));
    for (int n = 27; n < 34; ++n) f.mask[kField.index(30, n)] = kSaturated;
    EXPECT_TRUE(found_in(f));
    for (int n = 26; n < 35; ++n) {
        for (int m = 26; m < 35; ++m) f.mask[kField.index(m, n)] = kDark;
    }
    EXPECT_FALSE(found_in(f));
}

// Most of what is judged, in a ring. It takes no light, or some: then it is the part, and the ring is its dark rim.
TEST(MissingMaterial, is_most_of_a_plate_if_it_is_as_light_as_the_field_beside) {
    constexpr double kMiddle = 1.087;
    const Field f =
        field([](int m, int n) { return std::max(std::abs(m - 30), std::abs(n - 30)) <= 7 ? kMiddle : 1; }, 20, 40);
    constexpr auto kBeside = static_cast<float>(kMiddle * kLight);
    EXPECT_FALSE(found_in(f, 1, PartForm::plate));
    EXPECT_FALSE(found_in(f, 1, PartForm::plate, 1.04F * kBeside));
    const auto found = found_in(f, 1, PartForm::plate, kBeside);
    ASSERT_TRUE(found);
    EXPECT_LE(std::hypot(found->m - 30, found->n - 30), 2);
    EXPECT_NEAR(found->length, 15, 4);
}

TEST(MissingMaterial, of_fewer_lenslets_than_a_defect_has_is_none) {
    const Field f = field(hole(30, 30, 0.5, 1.6));
    EXPECT_TRUE(found_in(f, 1));
    EXPECT_FALSE(found_in(f, 10));
}

TEST(MissingMaterial, is_sought_without_allocating) {
    const Field f = field(hole(33, 27, 5, 1.08));
    MissingMaterialFinder finder(kField);
    bool any = false;
    EXPECT_EQ(hord::test::allocated_by([&] { any = finder.find(f.sums, f.mask).has_value(); }), 0U);
    EXPECT_TRUE(any);
}

TEST(MissingMaterial, is_sought_in_fields_of_any_size) {
    for (const Extents& e : {Extents{1, 1, 9, 9}, Extents{3, 90, 9, 9}, Extents{64, 5, 9, 9}, Extents{129, 12, 9, 9}}) {
        MissingMaterialFinder finder(e);
        const std::vector<std::uint32_t> sums(e.lenslets(), kLight);
        const std::vector<std::uint8_t> mask(e.lenslets(), kValid);
        EXPECT_FALSE(finder.find(sums, mask)) << e.m << "x" << e.n;
    }
}

// A film with a hole, judged as a web: the verdict, and what is switched off with the light.
TEST(MissingMaterial, rejects_a_part_that_all_else_passes) {
    const auto film = [](double light) {
        return noisy(drawn(kField, 8, 200,
                           [=](int m, int n) { return Spot{.light = std::hypot(m - 20, n - 35) < 4 ? light : 0.9}; }),
                     {}, 11);
    };
    Recipe recipe;
    recipe.form = PartForm::web;
    recipe.part_required = false;
    const auto judged = [&](const Recipe& r, const Frame& frame) {
        auto pipeline = Pipeline::create(kField, 8, r);
        EXPECT_TRUE(pipeline);
        const auto found = pipeline->inspect(frame.view());
        EXPECT_TRUE(found);
        return std::tuple(found->verdict, found->reason, found->defects.empty() ? Defect{} : found->defects.front());
    };
    EXPECT_EQ(std::get<0>(judged(recipe, film(0.9))), Verdict::pass);
    const auto [verdict, reason, defect] = judged(recipe, film(1));
    EXPECT_EQ(verdict, Verdict::reject);
    EXPECT_EQ(reason, Reason::missing_material);
    EXPECT_LE(std::hypot(defect.m - 20, defect.n - 35), 4);
    recipe.light = false;
    EXPECT_EQ(std::get<0>(judged(recipe, film(1))), Verdict::pass);
}

// A plate of half of the light with a hole over a tenth of it or more. The light that a tenth exceeds is that of the
// hole: relative to it the whole plate is a stain. Where no hole is seen, as of a plate that is covered but for glass
// here and there, it is.
TEST(MissingMaterial, of_a_dark_plate_with_a_large_hole_is_the_hole_and_not_the_plate) {
    constexpr double kGlass = 0.5;
    const auto judged = [](const std::function<double(int m, int n)>& light) {
        Recipe recipe;
        recipe.form = PartForm::plate;
        auto pipeline = Pipeline::create(kField, 8, recipe);
        EXPECT_TRUE(pipeline);
        const Frame plate = drawn(kField, 8, 220, [&](int m, int n) {
            const int into = 15 - std::max(std::abs(m - 30), std::abs(n - 30));
            return Spot{.light = into < 0 ? 1 : into == 0 ? 0 : light(m, n)};
        });
        const auto found = pipeline->inspect(noisy(plate, {10, 2, 1}, 7).view());
        EXPECT_TRUE(found);
        EXPECT_EQ(found->verdict, Verdict::reject);
        return std::tuple(found->reason, found->defects.empty() ? Defect{} : found->defects.front());
    };
    const auto from_hole = [](double m, double n) { return std::hypot(m - 36, n - 25); };
    for (const double radius : {5.0, 5.5, 6.0}) {
        const auto [reason, hole_found] = judged([=](int m, int n) { return from_hole(m, n) < radius ? 1 : kGlass; });
        EXPECT_EQ(reason, Reason::missing_material) << radius;
        EXPECT_LE(from_hole(static_cast<double>(hole_found.m), static_cast<double>(hole_found.n)), 2) << radius;
        EXPECT_NEAR(static_cast<double>(hole_found.length), 2 * radius, 4) << radius;
    }
    const auto clear_glass = [=](int m, int n) { return from_hole(m, n) < 6 ? 0.92 : 0.4; };
    EXPECT_EQ(std::get<0>(judged(clear_glass)), Reason::absorption);
    const auto smooth = [=](int m, int n) {
        return std::min(1.0, 0.3 + 1.4 * std::exp(-std::pow(from_hole(m, n) / 8, 2)));
    };
    EXPECT_EQ(std::get<0>(judged(smooth)), Reason::absorption);
}

}  // namespace
}  // namespace hord::algo
