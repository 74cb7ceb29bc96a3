// Vials, plates and webs as the simulated camera sees them (hal_sim/scenes), in noise: good ones pass in several poses,
// defects are found where they change the frame. The table of docs/results/inspection.md:
// HORD_LONG_TESTS=1 test_algo_inspection --gtest_filter='*RenderedForm*' prints it.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/scene/scene.h"

namespace hord::algo {
namespace {

using namespace hord::sim;

bool long_tests() { return std::getenv("HORD_LONG_TESTS") != nullptr; }

// A scene of the tree, through the middle of its field: as many lenslets as a test can afford.
sim::Scene scene_of(const char* name, int columns, int rows) {
    auto file = std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes" / name;
    auto scene = load_scene(file += ".toml");
    EXPECT_TRUE(scene) << scene.error().message();
    const double lenslet_mm = scene->camera.field_mm / scene->camera.extents.m;
    if (!long_tests()) {
        scene->camera.extents.m = columns;
        scene->camera.extents.n = rows;
        scene->camera.field_mm = lenslet_mm * columns;
    }
    scene->noise.electrons_per_dn = 10;
    scene->noise.read_e = 2;
    return *scene;
}

LightField rendered(const sim::Scene& scene) {
    auto field = render(scene, {1, {}});
    EXPECT_TRUE(field) << field.error().message();
    return std::move(*field);
}

Recipe recipe_of(PartForm form) {
    Recipe recipe;
    recipe.form = form;
    recipe.part_required = form != PartForm::web;
    return recipe;
}

struct Tally {
    int frames = 0, passed = 0;
    int found = 0;                 // rejected, with a defect within kNear lenslets of a place
    float worst = 0;               // largest score
    Reason reason = Reason::none;  // of the last frame
    int unfit = 0;
};
constexpr double kNear = 3;

// Judges `seeds` exposures of a light field. `places`: lenslets that a defect changes.
Tally tally(const sim::Scene& scene, const LightField& field, const Recipe& recipe, int seeds,
            const std::vector<Point>& places = {}) {
    Tally result;
    auto pipeline = Pipeline::create(field.extents, scene.camera.bits, recipe);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    for (int seed = 1; seed <= seeds; ++seed) {
        const Frame frame = expose(field, scene, static_cast<std::uint64_t>(seed));
        const auto seen = pipeline->inspect(frame.view());
        EXPECT_TRUE(seen);
        ++result.frames;
        result.passed += seen->verdict == Verdict::pass ? 1 : 0;
        result.worst = std::max(result.worst, seen->score);
        result.reason = seen->reason;
        const bool found = std::ranges::any_of(seen->defects, [&](const Defect& d) {
            return std::ranges::any_of(places,
                                       [&](const Point& p) { return std::hypot(d.m - p.m, d.n - p.n) <= kNear; });
        });
        result.found += found ? 1 : 0;
        result.unfit += seen->verdict == Verdict::unfit ? 1 : 0;
    }
    return result;
}

// The lenslets in which more than a tenth of the free light is elsewhere.
std::vector<Point> changed(const LightField& good, const LightField& bad) {
    const Extents& e = good.extents;
    std::vector<Point> places;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            double change = 0, free_light = 0;
            for (int y = n * e.j; y < (n + 1) * e.j; ++y) {
                for (int x = m * e.i; x < (m + 1) * e.i; ++x) {
                    const auto k = static_cast<std::size_t>(y) * static_cast<std::size_t>(e.width_px()) +
                        static_cast<std::size_t>(x);
                    change += std::abs(static_cast<double>(good.bins[k]) - static_cast<double>(bad.bins[k]));
                }
            }
            for (int y = 0; y < e.j; ++y) {
                for (int x = 0; x < e.i; ++x)
                    free_light += static_cast<double>(good.bins[static_cast<std::size_t>(y * e.width_px() + x)]);
            }
            if (change > 0.1 * free_light) places.push_back({static_cast<float>(m), static_cast<float>(n)});
        }
    }
    return places;
}

void print(const char* part, const char* defect, double radius_mm, const Tally& t, std::size_t lenslets) {
    if (long_tests())
        std::printf("| %s | %s | %.3g | %zu | %d | %d | %d | %.2f |\n", part, defect, radius_mm, lenslets, t.frames,
                    t.passed, t.found, static_cast<double>(t.worst));
}

struct Case {
    const char* what;
    const char* scene;
    PartForm form;
    int columns, rows;              // of the part of the field, if the test is short
    double near, middle;            // z of the face towards the camera, and of a place in the glass; mm
    double bubble, speck, scratch;  // radii of defects that are found, mm
    friend std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.what; }
};

const Case kCases[] = {{"empty_vial", "vial-empty", PartForm::tube, 65, 19, 6, 5.5, 0.3, 0.25, 0.2},
                       {"filled_vial", "vial-filled", PartForm::tube, 65, 19, 6, 5.5, 0.3, 0.25, 0.2},
                       {"plate", "plate", PartForm::plate, 89, 71, 1, 0, 0.2, 0.1, 0.05},
                       {"web", "web", PartForm::web, 41, 41, 0.25, 0, 0.15, 0.1, 0.05}};

class RenderedForm : public ::testing::TestWithParam<Case> {
  protected:
    [[nodiscard]] static sim::Scene scene() { return scene_of(GetParam().scene, GetParam().columns, GetParam().rows); }
};

TEST_P(RenderedForm, of_a_good_part_passes_in_every_pose) {
    Tally all;
    for (const auto& [x_mm, y_mm, turn_rad] : {std::tuple(0.0, 0.0, 0.0), std::tuple(0.31, -0.13, 0.03),
                                               std::tuple(-0.52, 0.4, -0.05), std::tuple(0.1, 0.27, 0.01)}) {
        sim::Scene good = scene();
        good.pose.x_mm = x_mm;
        good.pose.y_mm = y_mm;
        good.pose.rotation_rad = turn_rad;
        const Tally t = tally(good, rendered(good), recipe_of(GetParam().form), 6);
        EXPECT_EQ(t.passed, t.frames) << "shifted by " << x_mm << ", turned by " << turn_rad << ": "
                                      << name_of(t.reason) << " " << t.worst;
        all.frames += t.frames;
        all.passed += t.passed;
        all.worst = std::max(all.worst, t.worst);
    }
    print(GetParam().what, "none", 0, all, 0);
}

TEST_P(RenderedForm, with_a_defect_is_rejected_at_the_defect) {
    const Case& c = GetParam();
    struct Bad {
        const char* what;
        double radius_mm;
        SceneDefect defect;
        bool must_be_found = true;
    };
    const auto speck = [](double x, double y, double r) { return AbsorbingSpeck{{x, y, 0}, r, 0}; };
    const auto bubble = [&](double r) { return AirBubble{{0.6, 0.5, c.middle}, r}; };
    const auto scratch = [&](double r) { return Scratch{{-0.5, -1.2, c.near}, {-0.2, 1.4, c.near}, r}; };
    std::vector<Bad> defects{{"speck on the axis", c.speck, speck(0, 1, c.speck)},
                             {"speck beside the axis", c.speck, speck(1.3, -0.8, c.speck)},
                             {"bubble", c.bubble, bubble(c.bubble)},
                             {"scratch", c.scratch, scratch(c.scratch)}};
    if (c.form != PartForm::tube) {  // 20 um deep and 1.1 mm wide; the light turns by up to 2.4 bins
        const double radius = 8, depth = 0.02;
        defects.push_back({"dimple", radius, SphericalCut{{-1.1, -0.4, c.near + radius - depth}, radius}});
    }
    if (long_tests()) {  // what is hard to find, for the table
        defects.push_back({"speck beside the axis", c.speck / 2, speck(1.3, -0.8, c.speck / 2), false});
        defects.push_back({"bubble", c.bubble / 2, bubble(c.bubble / 2), false});
        defects.push_back({"scratch", c.scratch / 2, scratch(c.scratch / 2), false});
    }
    const sim::Scene good = scene();
    const LightField good_field = rendered(good);
    for (const Bad& one : defects) {
        sim::Scene bad = good;
        bad.defects.push_back(one.defect);
        const LightField bad_field = rendered(bad);
        const std::vector<Point> places = changed(good_field, bad_field);
        const Tally t = tally(bad, bad_field, recipe_of(c.form), long_tests() ? 20 : 3, places);
        print(c.what, one.what, one.radius_mm, t, places.size());
        if (!one.must_be_found) continue;
        EXPECT_EQ(t.passed, 0) << one.what << ", " << places.size() << " lenslets, score " << t.worst;
        // In a field that a tube fills, a speck may hide that there is a tube: no part.
        EXPECT_EQ(t.found + (c.form == PartForm::tube ? t.unfit : 0), t.frames) << one.what;
        EXPECT_GT(t.found, t.unfit) << one.what;
    }
}

// A fully dark spot of any size that covers a lenslet which the good frame lets judge is rejected: it changes neither
// what is part nor what is flank. Along both axes.
TEST_P(RenderedForm, with_a_dark_spot_on_any_judged_lenslet_is_rejected) {
    sim::Scene good = scene();
    for (const bool turned : {false, true}) {
        if (turned) {
            good.pose.rotation_rad = std::numbers::pi / 2;
            std::swap(good.camera.extents.m, good.camera.extents.n);
            good.camera.field_mm *= static_cast<double>(good.camera.extents.m) / good.camera.extents.n;
        }
        const LightField field = rendered(good);
        const Extents& e = field.extents;
        auto pipeline = Pipeline::create(e, good.camera.bits, recipe_of(GetParam().form));
        ASSERT_TRUE(pipeline);
        const Frame clean = expose(field, good, 1);
        const auto seen = pipeline->inspect(clean.view());
        ASSERT_TRUE(seen);
        ASSERT_EQ(seen->verdict, Verdict::pass);
        const std::vector<std::uint8_t> mask(seen->mask.begin(), seen->mask.end());
        std::mt19937_64 random(7);
        int spots = 0;
        for (int tried = 0; tried < (long_tests() ? 500 : 80); ++tried) {
            const auto below = [&](int end) { return static_cast<int>(random() % static_cast<std::uint64_t>(end)); };
            const int m = below(e.m), n = below(e.n), radius = tried % 3 == 0 ? 0 : below(std::min(e.m, e.n) / 3);
            LightField spotted = field;
            bool judged = false;
            for (int y = 0; y < e.height_px(); ++y) {
                for (int x = 0; x < e.width_px(); ++x) {
                    const int right = x / e.i - m, down = y / e.j - n;
                    if (right * right + down * down > radius * radius) continue;
                    spotted.bins[static_cast<std::size_t>(y) * static_cast<std::size_t>(e.width_px()) +
                                 static_cast<std::size_t>(x)] = 0;
                    judged = judged || (mask[e.index(m + right, n + down)] & kNotJudged) == 0;
                }
            }
            if (!judged) continue;
            ++spots;
            const Frame frame = expose(spotted, good, static_cast<std::uint64_t>(tried));
            const auto found = pipeline->inspect(frame.view());
            ASSERT_TRUE(found);
            // A spot may also hide that there is a tube or a plate: unfit.
            const bool may_hide = GetParam().form == PartForm::tube || GetParam().form == PartForm::plate;
            const bool bad = found->verdict == Verdict::reject || (may_hide && found->verdict == Verdict::unfit);
            EXPECT_TRUE(bad) << m << ", " << n << ", radius " << radius << (turned ? ", turned" : "");
        }
        EXPECT_GT(spots, 20);
        if (long_tests()) std::printf("%s: %d spots\n", GetParam().what, spots);
    }
}

std::string name_of_case(const ::testing::TestParamInfo<Case>& one) { return one.param.what; }
INSTANTIATE_TEST_SUITE_P(All, RenderedForm, ::testing::ValuesIn(kCases), name_of_case);

// Full or thick-walled on few lenslets: steep along their whole length; and their edges are askew.
TEST(RenderedVial, that_is_good_passes_on_few_lenslets_though_it_is_steep) {
    for (const double contents : {1.0, 1.33}) {
        for (const double inner_mm : {5.0, 4.0}) {
            for (const double lenslet_mm : {0.6, 0.48}) {
                sim::Scene good = scene_of("vial-filled", 0, 0);
                good.camera.extents = {static_cast<int>(15 / lenslet_mm), 24, 9, 9};
                good.camera.field_mm = lenslet_mm * good.camera.extents.m;
                good.pose.rotation_rad = 0.02;
                auto& vial = std::get<Vial>(good.part);
                vial.inner_radius_mm = inner_mm;
                vial.contents_index = contents;
                // An empty one hardly bends light by its thin wall, and a thick one very fast beside its flanks.
                if (contents < 1.1 && lenslet_mm > 0.5) continue;
                const Tally t = tally(good, rendered(good), recipe_of(PartForm::tube), 3);
                EXPECT_EQ(t.passed, t.frames) << contents << ", " << inner_mm << ", " << lenslet_mm << ": "
                                              << name_of(t.reason) << " " << t.worst;
                good.defects.push_back(AbsorbingSpeck{{0.3, 0.5, 0}, 0.5, 0});
                EXPECT_EQ(tally(good, rendered(good), recipe_of(PartForm::tube), 1).passed, 0);
            }
        }
    }
}

// The rule for round parts rejects every good vial: its flanks are dark.
TEST(RenderedVial, is_rejected_by_the_rule_for_round_parts) {
    for (const char* name : {"vial-empty", "vial-filled"}) {
        const sim::Scene scene = scene_of(name, 69, 31);
        EXPECT_EQ(tally(scene, rendered(scene), recipe_of(PartForm::round), 2).passed, 0) << name;
    }
}

}  // namespace
}  // namespace hord::algo
