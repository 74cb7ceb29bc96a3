// Frames that show nothing to judge never pass; good parts do. The kinds of frames: tests/support/odd_frames.h.
#include "algo/inspection/frame_checks.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <sstream>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/scene/scene.h"
#include "tests/support/light_image.h"
#include "tests/support/odd_frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kUsual{111, 111, 9, 9};
double middle_m(const Extents& e) { return 0.5 * (e.m - 1); }
const Extents kGeometries[] = {kUsual,           {45, 45, 9, 9}, {45, 45, 5, 5},
                               {45, 45, 15, 15}, {40, 36, 9, 9}, {36, 45, 7, 8}};

// Without the maps, which end with the pipeline.
Inspection inspected(const Extents& e, const Frame& frame, const Recipe& recipe = {}) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline);
    const auto found = pipeline->inspect(frame.view());
    EXPECT_TRUE(found);
    Inspection copy;
    copy.verdict = found->verdict;
    copy.reason = found->reason;
    copy.score = found->score;
    copy.dark_dn = found->dark_dn;
    copy.frame = found->frame;
    return copy;
}

std::string told(const Inspection& found) {
    const FrameFindings& f = found.frame;
    std::ostringstream text;
    text << std::fixed << std::setprecision(2) << name_of(found.verdict) << " " << name_of(found.reason) << ", fault "
         << static_cast<int>(f.fault) << ", dark " << found.dark_dn << " (" << f.pedestal_dn << " +- "
         << f.dark_noise_dn << "), free " << f.in_free_light << ", offset " << f.x_bins << " " << f.y_bins << ", spot "
         << f.spot_x_bins << " " << f.spot_y_bins << ", second " << f.second_share << ", period " << f.period_x << " "
         << f.period_y << ", parts " << f.parts << ", cut " << f.border_cut << ", sharp " << f.sharp_share
         << ", beside " << f.free_beside << ", symmetry " << f.symmetry << ", convexity " << f.convexity
         << ", deflecting " << f.deflecting << ", undeflected " << f.undeflected_share << ", alternation "
         << f.alternation_bins << " " << f.alternation_light << ", score " << found.score;
    return text.str();
}

// HORD_TABLE=1 prints what each kind gives.
void print(const Kind& kind, const Inspection& found) {
    if (std::getenv("HORD_TABLE") != nullptr) std::cout << kind.name << ": " << told(found) << "\n";
}

class Field : public ::testing::TestWithParam<Extents> {};

TEST_P(Field, that_shows_nothing_to_judge_never_passes) {
    int count = 0;
    for (const Kind& kind : unfit_kinds()) {
        for (const std::uint64_t seed : {1U, 2U}) {
            const auto frame = kind.frame(GetParam(), seed);
            if (!frame) continue;
            ++count;
            const Inspection found = inspected(GetParam(), *frame);
            print(kind, found);
            EXPECT_NE(found.verdict, Verdict::pass) << kind.name << ": " << told(found);
        }
    }
    EXPECT_GE(count, 2 * 60);
}

TEST_P(Field, of_a_good_part_passes) {
    for (const Kind& kind : good_kinds()) {
        for (const std::uint64_t seed : {1U, 2U}) {
            const auto frame = kind.frame(GetParam(), seed);
            ASSERT_TRUE(frame);
            const Inspection found = inspected(GetParam(), *frame);
            print(kind, found);
            EXPECT_EQ(found.verdict, Verdict::pass) << kind.name << ": " << told(found);
        }
    }
}

std::string name_of_field(const ::testing::TestParamInfo<Extents>& field) {
    const Extents& e = field.param;
    return std::to_string(e.m) + "x" + std::to_string(e.n) + "_of_" + std::to_string(e.i) + "x" + std::to_string(e.j);
}

INSTANTIATE_TEST_SUITE_P(Of, Field, ::testing::ValuesIn(kGeometries), name_of_field);

// The reason says what to mend.
TEST(FrameChecks, give_the_reason) {
    using enum FrameFault;
    const std::map<std::string, std::pair<Reason, FrameFault>> expected = {
        {"black", {Reason::too_dark, none}},
        {"white", {Reason::saturated, none}},
        {"grey fog, 120 DN", {Reason::unexpected_light, pedestal}},
        {"fog with a gradient", {Reason::unexpected_light, pedestal}},
        {"empty field", {Reason::no_part, nothing}},
        {"empty field with specks of dust", {Reason::no_part, nothing}},
        {"empty field, light bent slowly", {Reason::no_part, no_outline}},
        {"empty field, shifted by 1.0 samples", {Reason::unexpected_light, off_centre}},
        {"lens, shifted by 1.5 samples", {Reason::unexpected_light, off_centre}},
        {"lens, shifted by 4.0 samples", {Reason::unexpected_light, second_spot}},
        {"lens, ghost of 20 %", {Reason::unexpected_light, second_spot}},
        {"lens, defocused", {Reason::unexpected_light, wide_spot}},
        {"lens, pedestal of 20 DN", {Reason::unexpected_light, pedestal}},
        {"lens, stuck columns", {Reason::unexpected_light, interrupted}},
        {"lens of 3x3 bins", {Reason::unexpected_geometry, other_period}},
        {"empty field of 3x3 bins", {Reason::unexpected_geometry, other_period}},
        {"two parts", {Reason::no_part, several}},
        {"a part and a second one of 0.45 of its size, in a corner", {Reason::no_part, several}},
        {"a part and a second one of 0.20 of its size, in a corner", {Reason::no_part, several}},
        {"a part and a plate of 0.30 of its size", {Reason::no_part, several}},
        {"half a part at the field's left border", {Reason::no_part, cut_by_field}},
        {"half a part in the middle of the field", {Reason::no_part, lopsided}},
        {"a part that fills the field", {Reason::no_part, fills_field}},
        {"an opaque holder without a part", {Reason::no_part, nothing}},
        {"a part without a quarter, at its right", {Reason::no_part, lopsided}},
        {"a part with a slot from its right", {Reason::no_part, lopsided}},
        {"a part with a bite at its right", {Reason::no_part, lopsided}},
        {"a part without a chord", {Reason::no_part, lopsided}},
        {"a third of a part", {Reason::no_part, lopsided}},
        {"a part with bites at both sides", {Reason::no_part, notched}},
        {"a cross cut from a part", {Reason::no_part, notched}},
        {"a part with two slots, turned by 180 degrees", {Reason::no_part, notched}},
        {"a grey disc, 0.15 of the light", {Reason::no_part, hollow}},
        {"a thin dark ring with nothing in it", {Reason::no_part, hollow}},
        {"lens, even stray light in its middle, five times the free light", {Reason::unexpected_light, glare}},
        {"lens and an empty field, row by row", {Reason::unexpected_light, alternating}},
        {"lens and an empty field, lenslet by lenslet", {Reason::unexpected_light, alternating}},
        {"lens, every second column with 60 % of the light", {Reason::unexpected_light, alternating}},
        {"lens and an empty field in one exposure, 0.5 of it", {Reason::unexpected_light, second_spot}},
    };
    std::size_t seen = 0;
    for (const Kind& kind : unfit_kinds()) {
        const auto found = expected.find(kind.name);
        if (found == expected.end()) continue;
        ++seen;
        const Inspection inspection = inspected(kUsual, kind.frame(kUsual, 3).value());
        EXPECT_EQ(inspection.verdict, Verdict::unfit) << kind.name;
        EXPECT_EQ(inspection.reason, found->second.first) << kind.name << ": " << told(inspection);
        EXPECT_EQ(inspection.frame.fault, found->second.second) << kind.name << ": " << told(inspection);
    }
    EXPECT_EQ(seen, expected.size());
}

// 3x3 macro-pixels read as 9x9, and 9x9 as 3x3: the period that was found is named.
TEST(FrameChecks, name_the_period_of_another_geometry) {
    for (const auto& [real, said] : {std::pair(3, 9), std::pair(9, 3), std::pair(5, 15), std::pair(15, 5)}) {
        const Extents e{90, 90, real, real}, read_as{90 * real / said, 90 * real / said, said, said};
        const Frame frame = exposed(spots(e, 200, 0.5, lens(e, 32, 0.25 * real)), {}, 1);
        const Inspection found = inspected(read_as, frame);
        EXPECT_EQ(found.reason, Reason::unexpected_geometry) << told(found);
        EXPECT_EQ(std::pair(found.frame.period_x, found.frame.period_y), std::pair(real, real));
    }
}

TEST(FrameChecks, are_widened_and_switched_off_by_the_recipe) {
    const auto kind = [](const std::string& name) {
        for (const Kind& k : unfit_kinds()) {
            if (k.name == name) return k.frame(kUsual, 1).value();
        }
        return Frame();
    };
    Recipe recipe;
    recipe.max_offset_bins = 0;
    EXPECT_EQ(inspected(kUsual, kind("lens, shifted by 1.0 samples"), recipe).verdict, Verdict::pass);
    recipe = {};
    recipe.max_spot_bins = 2;
    EXPECT_NE(inspected(kUsual, kind("lens, defocused"), recipe).verdict, Verdict::unfit);
    recipe = {};
    recipe.max_second_share = 0.3F;
    EXPECT_NE(inspected(kUsual, kind("lens, ghost of 20 %"), recipe).frame.fault, FrameFault::second_spot);
    recipe = {};
    recipe.max_dark_rise_dn = 40;
    EXPECT_EQ(inspected(kUsual, kind("lens, pedestal of 20 DN"), recipe).verdict, Verdict::pass);
    recipe = {};
    recipe.symmetric_outline = false;
    EXPECT_NE(inspected(kUsual, kind("half a part in the middle of the field"), recipe).verdict, Verdict::unfit);
    EXPECT_NE(inspected(kUsual, kind("a cross cut from a part"), recipe).verdict, Verdict::unfit);
    recipe = {};
    recipe.part_required = false;
    EXPECT_EQ(inspected(kUsual, kind("empty field"), recipe).verdict, Verdict::pass);
    EXPECT_EQ(inspected(kUsual, kind("a part that fills the field"), recipe).verdict, Verdict::pass);
}

// A ghost near the spot blends with it, and one four bins away lies in the next lenslet in part.
TEST(FrameChecks, name_a_ghost_of_six_percent_and_let_three_pass) {
    constexpr Extents kSmall{48, 48, 9, 9};
    for (const double spread : {0.4, 0.6, 0.8}) {
        const LightImage light = spots(kSmall, 200, spread, lens(kSmall, 18, 3));
        for (const auto& [right, down] : {std::pair(2, 0), std::pair(-2, 0), std::pair(0, 2), std::pair(2, -1),
                                          std::pair(-3, 0), std::pair(4, 0), std::pair(0, -4)}) {
            const auto found = [&, across = right, along = down](double share) {
                return inspected(kSmall, exposed(with_ghost(light, share, across, along), {}, 1), {});
            };
            EXPECT_EQ(found(0.06).frame.fault, FrameFault::second_spot) << spread << " " << right << " " << down;
            EXPECT_EQ(found(0.03).verdict, Verdict::pass) << spread << " " << right << " " << down;
        }
    }
}

// The lit region of an opaque holder is the part; what the recipe's zones leave out is the holder.
TEST(FrameChecks, know_a_part_in_an_opaque_holder) {
    const Extents e{60, 60, 9, 9};
    const auto through = [&](double rim_bins) {
        return exposed(spots(e, 200, 0.5,
                             [=](int m, int n) {
                                 const Spot s = lens(e, 24, rim_bins)(m, n);
                                 const bool hole = std::hypot(m - 29.5, n - 29.5) <= 24;
                                 return Spot{s.x, s.y, hole ? 1.0 : 0.0};
                             }),
                       {}, 1);
    };
    Recipe recipe;
    Zone zone;
    zone.centre = {29.5F, 29.5F};
    zone.radius = 20;
    recipe.zones = {zone};
    EXPECT_EQ(inspected(e, through(3), recipe).verdict, Verdict::pass);
    EXPECT_EQ(inspected(e, through(0), recipe).reason, Reason::no_part);
}

TEST(FrameChecks, web_needs_no_part_and_is_held_to_its_light) {
    const Extents e{60, 60, 9, 9};
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    const LightImage film = spots(e, 200, 0.6, [](int m, int n) {
        return Spot{0.3 * std::sin(0.2 * m), 0.3 * std::cos(0.15 * n), 1};
    });
    EXPECT_EQ(inspected(e, exposed(film, {}, 1), web).verdict, Verdict::pass);
    EXPECT_EQ(inspected(e, exposed(film, {6, 1}, 1), web).verdict, Verdict::pass);
    EXPECT_EQ(inspected(e, exposed(moved_px(film, 1.5, 0), {}, 1), web).frame.fault, FrameFault::off_centre);
    EXPECT_EQ(inspected(e, exposed(blurred(film, 1.5), {}, 1), web).reason, Reason::unexpected_light);
    EXPECT_EQ(inspected(e, exposed(with_ghost(film, 0.2, 3, 0), {}, 1), web).reason, Reason::unexpected_light);
    const Extents other{180, 180, 3, 3};
    const Frame of_3x3 = exposed(spots(other, 200, 0.5, [](int, int) { return Spot{}; }), {}, 1);
    EXPECT_EQ(inspected(e, of_3x3, web).reason, Reason::unexpected_geometry);
}

// The same level, and so the same result, whatever the noise below the recipe's level does.
TEST(FrameChecks, leave_the_dark_level_of_a_frame_without_pedestal) {
    for (const double noise : {0.0, 0.6}) {
        const Frame frame = exposed(spots(kUsual, 200, 0.6, lens(kUsual, 42, 3)), {0, noise}, 1);
        EXPECT_EQ(inspected(kUsual, frame).dark_dn, kDarkDn8Bit);
    }
    const Frame raised = exposed(spots(kUsual, 200, 0.6, lens(kUsual, 42, 3)), {6, 0.6}, 1);
    EXPECT_NEAR(inspected(kUsual, raised).dark_dn, 8.5, 0.5);
}

// Light that lies turned about the middle by some hundredths of a degree is off the bins at the field's borders.
TEST(FrameChecks, tell_bins_that_are_turned_against_the_frame) {
    const auto found = [](double turn_rad, double rim_bins) {
        const auto part = lens(kUsual, 42, rim_bins);
        const double middle = middle_m(kUsual);
        return inspected(
            kUsual,
            exposed(
                spots(kUsual, 200, 0.6,
                      [&](int m, int n) {
                          const Spot s = part(m, n);
                          return Spot{s.x + 9 * turn_rad * (n - middle), s.y - 9 * turn_rad * (m - middle), s.light};
                      }),
                {}, 1));
    };
    for (const double degrees : {-0.2, -0.1, 0.1, 0.2}) {
        for (const double rim_bins : {0.0, 2.5}) {
            const double turn_rad = degrees * 3.14159265 / 180;
            const Inspection turned = found(turn_rad, rim_bins);
            EXPECT_EQ(turned.reason, Reason::unexpected_geometry) << degrees << ": " << told(turned);
            EXPECT_EQ(turned.frame.fault, FrameFault::turned);
            EXPECT_NEAR(static_cast<double>(turned.frame.turned_rad), turn_rad, 0.1 * std::abs(turn_rad));
        }
    }
    EXPECT_EQ(found(0, 2.5).verdict, Verdict::pass);
    // A lens that fills the field, a cylinder lens that stands askew, a wedge: no turn.
    const double middle = middle_m(kUsual);
    for (const auto& slopes :
         {std::array{0.04, 0.0, 0.0, 0.04}, std::array{0.02, 0.02, 0.02, 0.02}, std::array{0.0, 0.03, 0.03, 0.0}}) {
        const Frame frame = exposed(spots(kUsual, 200, 0.6,
                                          [&](int m, int n) {
                                              return Spot{slopes[0] * (m - middle) + slopes[1] * (n - middle),
                                                          slopes[2] * (m - middle) + slopes[3] * (n - middle), 1};
                                          }),
                                    {}, 1);
        EXPECT_EQ(inspected(kUsual, frame).frame.fault, FrameFault::fills_field);
    }
}

// Read noise up to 6 DN: a good part passes, or the frame is too noisy. It is never a defect.
TEST(FrameChecks, take_read_noise_for_no_defect_beside_a_bevel) {
    auto scene = sim::load_scene(std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes/plate.toml");
    ASSERT_TRUE(scene) << scene.error().message();
    scene->noise.electrons_per_dn = 10;
    const auto plate = sim::render(*scene);
    ASSERT_TRUE(plate);
    const LightImage round = spots(kUsual, 200, 0.6, lens(kUsual, 42, 3)),
                     narrow = spots(kUsual, 200, 0.35, lens(kUsual, 42, 3));
    int passed = 0;
    for (const double noise_dn : {2.0, 3.0, 4.0, 5.0, 6.0}) {
        scene->noise.read_e = 10 * noise_dn;
        const auto check = [&](const Frame& frame, PartForm form) {
            Recipe recipe;
            recipe.form = form;
            const Inspection found = inspected(kUsual, frame, recipe);
            EXPECT_TRUE(found.verdict == Verdict::pass || found.frame.fault == FrameFault::noise)
                << noise_dn << " DN: " << told(found);
            passed += found.verdict == Verdict::pass ? 1 : 0;
        };
        check(sim::expose(*plate, *scene, 1), PartForm::plate);
        check(sim::expose(*plate, *scene, 2), PartForm::plate);
        check(exposed(round, {0, noise_dn}, 1), PartForm::round);
        check(exposed(narrow, {0, noise_dn}, 1), PartForm::round);
    }
    EXPECT_GE(passed, 4 * 4);  // of 6 DN some are too noisy
}

// A warm pixel far from every spot has no neighbour; a second spot of light has.
TEST(FrameChecks, tell_a_sample_that_stands_alone_in_a_defect) {
    const LightImage part = spots(kUsual, 200, 0.6, lens(kUsual, 42, 3));
    Frame frame = exposed(part, {}, 1);
    auto pipeline = Pipeline::create(kUsual, 8, {});
    ASSERT_TRUE(pipeline);
    const auto lone = [&] {
        const auto found = pipeline->inspect(frame.view());
        EXPECT_TRUE(found);
        EXPECT_EQ(found->verdict, Verdict::reject);
        return std::tuple(found->lone_sample.x, found->lone_sample.y, found->lone_sample.dn);
    };
    const int x = 55 * 9 + 8, y = 50 * 9 + 1;
    frame.set(x, y, 120);
    EXPECT_EQ(lone(), std::tuple(x, y, 117U));
    frame.set(x, y + 1, 20);  // light of a spot beside it
    EXPECT_EQ(std::get<2>(lone()), 0U);
    frame.set(x, y + 1, 0);
    frame.set(x + 9, y + 9, 120);  // another one
    EXPECT_EQ(std::get<2>(lone()), 0U);
    frame.set(x + 9, y + 9, 0);
    frame.set(x + 9, y, 120);  // the lenslet beside it has a spot at this bin
    frame.set(x + 9, y + 1, 120);
    EXPECT_EQ(std::get<2>(lone()), 0U);
}

// The middle of a cylinder lens shows free light that is open at its ends. It is judged, and so is what lies beside it.
TEST(FrameChecks, reject_a_dark_lenslet_wherever_it_lies_on_a_cylinder_lens) {
    const Extents e{45, 45, 9, 9};
    const double half = 0.36 * e.m, middle = middle_m(e);
    for (const double rim_bins : {0.9, 2.5}) {  // 0.06 and 0.15 bins a lenslet
        const auto cylinder = [&](int dark_m, int dark_n) {
            return exposed(spots(e, 200, 0.6,
                                 [&](int m, int n) {
                                     const double right = m - middle;
                                     if (m == dark_m && n == dark_n) return Spot{0, 0, 0};
                                     const bool inside = std::abs(right) < half && std::abs(n - middle) < half;
                                     return inside ? Spot{-right / half * rim_bins, 0, 0.95} : Spot{};
                                 }),
                           {}, 1);
        };
        EXPECT_EQ(inspected(e, cylinder(-1, -1)).verdict, Verdict::pass);
        for (int m = 10; m <= 34; ++m)
            EXPECT_EQ(inspected(e, cylinder(m, 20)).verdict, Verdict::reject) << m << ", rim " << rim_bins;
    }
}

// The free middle of a cylinder lens that stands askew is enclosed in no row or column at its ends.
TEST(FrameChecks, reject_a_dark_lenslet_on_a_cylinder_lens_that_stands_askew) {
    const Extents e{45, 45, 9, 9};
    const double half = 0.3 * e.m, middle = middle_m(e);
    for (const double degrees : {45.0, 30.0, 10.0}) {
        for (const double rim_bins : {1.0, 2.5}) {
            const double right = std::cos(degrees * 3.14159265 / 180), down = std::sin(degrees * 3.14159265 / 180);
            const auto across = [&](int m, int n) { return right * (m - middle) + down * (n - middle); };
            const auto along = [&](int m, int n) { return right * (n - middle) - down * (m - middle); };
            const auto cylinder = [&](int dark_m, int dark_n) {
                return exposed(spots(e, 200, 0.6,
                                     [&](int m, int n) {
                                         if (m == dark_m && n == dark_n) return Spot{0, 0, 0};
                                         const double u = across(m, n);
                                         const double bins = -u / half * rim_bins;
                                         const bool inside = std::abs(u) < half && std::abs(along(m, n)) < half;
                                         return inside ? Spot{bins * right, bins * down, 0.95} : Spot{};
                                     }),
                               {}, 1);
            };
            EXPECT_EQ(inspected(e, cylinder(-1, -1)).verdict, Verdict::pass) << degrees << ", rim " << rim_bins;
            for (int n = 0; n < e.n; ++n) {
                for (int m = 0; m < e.m; ++m) {
                    // At both ends of the middle, three lenslets and a half inside the outline.
                    if (std::abs(across(m, n)) > 6 || std::abs(std::abs(along(m, n)) - (half - 4.2)) > 0.7) continue;
                    EXPECT_EQ(inspected(e, cylinder(m, n)).verdict, Verdict::reject)
                        << m << ", " << n << ": " << degrees << " degrees, rim " << rim_bins;
                }
            }
        }
    }
}

// Parts that the simulated cell renders are recognised as one whole part, at two places of the field.
TEST(FrameChecks, recognise_rendered_parts) {
    const sim::Part parts[] = {sim::DoubleConvexLens{}, sim::PlanoConvexLens{}, sim::CylinderLens{},
                               sim::Wedge{.tilt_x_rad = 0.06, .tilt_y_rad = 0.03}};
    for (const sim::Part& part : parts) {
        for (const double x_mm : {0.0, 1.2}) {
            sim::Scene scene;
            scene.part = part;
            scene.pose.x_mm = x_mm;
            scene.camera.extents = {55, 55, 9, 9};
            scene.noise.electrons_per_dn = 40;
            scene.noise.read_e = 8;
            scene.noise.dark_dn = 1;
            const auto field = sim::render(scene);
            ASSERT_TRUE(field);
            const Frame frame = sim::expose(*field, scene, 1);
            const Inspection found = inspected(scene.camera.extents, frame);
            EXPECT_NE(found.verdict, Verdict::unfit) << part.index() << ": " << told(found);
            auto pipeline = Pipeline::create(scene.camera.extents, frame.bits(), {});
            ASSERT_TRUE(pipeline);
            const auto mask = pipeline->inspect(frame.view())->mask;
            for (int m = 16; m < 40; ++m) EXPECT_EQ(mask[scene.camera.extents.index(m, 27)] & kNotJudged, 0) << m;
        }
    }
}

}  // namespace
}  // namespace hord::algo
