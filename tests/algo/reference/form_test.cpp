// Parts whose form varies as tolerances make it, and flaws of a known size.
#include <gtest/gtest.h>

#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

// Inside the part light is deflected by (x, y) bins more, and by `power` times what it is.
Frame part_of_form(
    const Pose& pose, double x, double y, double power,
    const std::function<void(int, int, Spot&)>& defect = [](int, int, Spot&) {}) {
    return part(pose, [&](int m, int n, Spot& s) {
        s.x += x + power * s.x, s.y += y + power * s.y;
        defect(m, n, s);
    });
}
constexpr double kTilt = 0.08, kPower = 0.03;  // standard deviations

const Learned& learned_forms() {
    static const Learned all = [] {
        std::vector<Frame> frames;
        std::mt19937_64 random(11);
        std::normal_distribution<double> normal;
        for (std::uint64_t k = 0; k < 24; ++k) {
            const double x = kTilt * normal(random), y = kTilt * normal(random), power = kPower * normal(random);
            frames.push_back(seen(part_of_form(wobble(k), x, y, power), k));
        }
        return learn(frames.size(), [&](std::size_t k) { return frames[k]; }).value();
    }();
    return all;
}
Recipe recipe_of_forms() {
    Recipe r = recipe();
    r.reference = std::make_shared<Reference>(learned_forms().reference);
    return r;
}

TEST(Form, of_good_parts_is_learned_inside_the_part_only) {
    const Reference& r = learned_forms().reference;
    EXPECT_NEAR(std::sqrt(r.form_variance[0]), kTilt, 0.5 * kTilt);
    EXPECT_NEAR(std::sqrt(r.form_variance[3]), kTilt, 0.5 * kTilt);
    EXPECT_GT(r.form_share[kField.index(20, 18)], 0.8F);
    EXPECT_LT(r.form_share[kField.index(2, 2)], 0.3F);
    for (const float variance : learned().reference.form_variance) EXPECT_LT(std::sqrt(variance), 0.01F);
}

TEST(Form, that_good_parts_have_is_no_defect_and_hides_none) {
    const Recipe r = recipe_of_forms();
    const auto speck = [](int m, int n, Spot& s) {
        if (m == 24 && n == 15) s.light *= 0.6;
    };
    const auto dimple = [](int m, int n, Spot& s) {
        if (std::abs(m - 24) <= 1 && std::abs(n - 15) <= 1) s.x += 0.25;
    };
    for (const double many : {-2.5, 0.0, 2.5}) {
        const double x = many * kTilt, power = -many * kPower;
        EXPECT_EQ(judge(seen(part_of_form(wobble(31), x, 0, power), 31), r).verdict, Verdict::pass) << many;
        for (const auto& defect : {std::function<void(int, int, Spot&)>(speck), std::function(dimple)}) {
            const Judged judged = judge(seen(part_of_form(wobble(31), x, 0, power, defect), 31), r);
            ASSERT_EQ(judged.verdict, Verdict::reject) << many;
            EXPECT_NEAR(judged.defects[0].m, 24, 0.7) << many;
            EXPECT_NEAR(judged.defects[0].n, 15, 0.7) << many;
        }
    }
}

// What no good part has is not explained away.
TEST(Form, that_is_far_from_that_of_good_parts_is_a_defect) {
    const Recipe r = recipe_of_forms();
    EXPECT_NE(judge(seen(part_of_form(wobble(32), 10 * kTilt, 0, 0), 32), r).verdict, Verdict::pass);
    EXPECT_NE(judge(seen(part_of_form(wobble(32), 0, 0, 12 * kPower), 32), r).verdict, Verdict::pass);
    EXPECT_NE(judge(seen(part_of_form(wobble(32), 0.2, 0, 0), 32)).verdict, Verdict::pass);  // of rigid parts
}

// The share of a lenslet that a disc covers.
double covered(int m, int n, double at_m, double at_n, double radius) {
    constexpr int kPoints = 16;
    int inside = 0;
    for (int k = 0; k < kPoints * kPoints; ++k) {
        const double x = m + (k % kPoints + 0.5) / kPoints - 0.5, y = n + (k / kPoints + 0.5) / kPoints - 0.5;
        inside += std::hypot(x - at_m, y - at_n) < radius ? 1 : 0;
    }
    return static_cast<double>(inside) / (kPoints * kPoints);
}

TEST(FlawSize, is_that_of_the_light_that_is_missing) {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> offset(-0.5, 0.5);
    for (const double depth : {1.0, 0.5}) {
        for (const double radius : {0.3, 0.5, 0.8, 1.2, 2.0, 3.0}) {
            if (depth * radius < 0.3) continue;
            for (std::uint64_t seed = 0; seed < 4; ++seed) {
                const double m = 22 + offset(random), n = 17 + offset(random);
                const Judged judged =
                    judge(seen(part(wobble(40 + seed),
                                    [&](int x, int y, Spot& s) { s.light *= 1 - depth * covered(x, y, m, n, radius); }),
                               seed));
                ASSERT_FALSE(judged.defects.empty()) << radius;
                const Defect& d = judged.defects[0];
                // The half-covered light of a disc of less than a lenslet may be that of a smaller, opaque one.
                const double least = radius < 1 ? radius * std::sqrt(depth) : radius;
                EXPECT_GT(d.radius, least - 0.15) << radius << " " << depth;
                EXPECT_LT(d.radius, radius + 0.15) << radius << " " << depth;
                EXPECT_LT(std::hypot(d.m - m, d.n - n), 0.15) << radius << " " << depth;
            }
        }
    }
}

// All light of a disc goes to other bins.
TEST(FlawSize, is_that_of_the_light_that_is_bent) {
    for (const double radius : {1.2, 2.0, 3.0}) {
        const double m = 22.3, n = 16.8;
        const Frame rest = part(wobble(50), [&](int x, int y, Spot& s) { s.light *= 1 - covered(x, y, m, n, radius); });
        const Frame moved = part(wobble(50), [&](int x, int y, Spot& s) {
            s.light *= covered(x, y, m, n, radius);
            s.y += 2.5;
        });
        // `moved` holds the free light beside the part, too: only what lies near the flaw is taken from it.
        Frame frame = rest;
        for (int y = 10 * kField.j; y < 24 * kField.j; ++y) {
            for (int x = 15 * kField.i; x < 30 * kField.i; ++x)
                frame.set(x, y, rest.view().sample(x, y) + moved.view().sample(x, y));
        }
        const Judged judged = judge(seen(frame, 5));
        ASSERT_FALSE(judged.defects.empty()) << radius;
        EXPECT_NEAR(judged.defects[0].radius, radius, 0.2);
        EXPECT_NEAR(judged.defects[0].m, m, 0.2);
        EXPECT_NEAR(judged.defects[0].n, n, 0.2);
    }
}

}  // namespace
}  // namespace hord::algo
