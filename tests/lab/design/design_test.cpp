// The search for a cell: what is ruled out, what a trial measures, and that its shortcuts show what whole parts do.
#include "lab/design/design.h"

#include <cmath>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::lab {
namespace {

using ::testing::HasSubstr;

// 55x55 lenslets with 5x5 bins, coarse pixels so that the lenslets can be bought.
DesignTask small_task(const std::string& defects) {
    DesignTask task;
    task.part.name = "lens";
    task.part.part = sim::DoubleConvexLens{};
    task.camera.pixels = 275.0 * 275.0;
    task.camera.pixel_um = 20;
    task.defects = *parse_defects(defects);
    task.threads = 1;
    return task;
}
constexpr CellChoice kCell{5, 0.04, 1, 0.61, 1};

TEST(WantedDefects, are_kinds_with_sizes) {
    const auto defects = parse_defects("bubble=0.2,scratch=0.03");
    ASSERT_TRUE(defects);
    ASSERT_EQ(defects->size(), 2U);
    EXPECT_EQ((*defects)[1].kind, WantedKind::scratch);
    EXPECT_EQ((*defects)[1].size_mm, 0.03);
}

TEST(WantedDefects, that_are_unknown_twice_or_without_a_size_are_refused_with_the_kinds) {
    for (const char* wrong : {"", "bubble", "bubble=", "bubble=0", "bubble=0.2mm", "hole=0.2", "bubble=0.2,"}) {
        const auto refused = parse_defects(wrong);
        ASSERT_FALSE(refused) << wrong;
        EXPECT_THAT(refused.error().message(), HasSubstr("bubble, cut, dimple"));
    }
    EXPECT_FALSE(parse_defects("bubble=0.2,bubble=0.3"));
}

TEST(WantedDefects, touch_the_face_that_they_belong_to) {
    const DesignTask task = small_task("bubble=0.2");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    const auto make = [&](WantedKind kind, double size) {
        return make_defect(kind, size, task.part, survey->body, 3, -2, 0.4).value();
    };
    ThroughPart way;
    ASSERT_TRUE(way_through(survey->body, 3, -2, way));
    // The rim of a cut of 0.4 mm: its ball meets the face 0.2 mm from its middle.
    const auto cut = std::get<sim::SphericalCut>(make(WantedKind::cut, 0.4));
    const double to_face = sim::length(cut.centre_mm - way.leaves);
    EXPECT_NEAR(std::sqrt(cut.radius_mm * cut.radius_mm - to_face * to_face), 0.2, 1e-9);
    EXPECT_GT(cut.centre_mm.z, way.leaves.z);  // outside, towards the camera
    const auto dimple = std::get<sim::Dimple>(make(WantedKind::dimple, 0.6));
    EXPECT_LT(dimple.centre_mm.z, way.enters.z);
    const auto scratch = std::get<sim::Scratch>(make(WantedKind::scratch, 0.02));
    const sim::Vec3 middle = 0.5 * (scratch.from_mm + scratch.to_mm);
    EXPECT_NEAR(sim::length(middle - way.leaves), 0, 1e-9);
    const auto bubble = std::get<sim::AirBubble>(make(WantedKind::bubble, 0.2));
    EXPECT_GT(bubble.centre_mm.z - 0.1, way.enters.z);
    EXPECT_LT(bubble.centre_mm.z + 0.1, way.leaves.z);
}

TEST(Cells, that_cannot_be_built_or_cannot_show_the_part_are_ruled_out_with_the_reason) {
    const DesignTask task = small_task("bubble=0.2");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    // The lens sends light of its rim to 10 / 190 rad, at the most.
    EXPECT_NEAR(survey->largest_slope, 10.0 / 190.76, 0.003);
    const auto problem = [&](CellChoice cell, CameraLimits camera) {
        return problem_of(cell, task.part, camera, survey->largest_slope);
    };
    EXPECT_EQ(problem(kCell, task.camera), "");
    EXPECT_THAT(problem({5, 0.015, 1, 0.61, 1}, task.camera), HasSubstr("leaves the bins"));
    CameraLimits fine = task.camera;
    fine.pixels = 25e6;  // 333 lenslets of 72 um: their diffraction is 8.2 mrad wide
    EXPECT_THAT(problem({15, 0.0078, 1, 0.3, 1}, fine), HasSubstr("diffraction"));
    CameraLimits slow = task.camera;
    slow.pixel_um = 2;
    EXPECT_THAT(problem(kCell, slow), HasSubstr("faster than f/1"));
    EXPECT_THAT(problem({15, 0.04, 1, 0.61, 1}, task.camera), HasSubstr("fewer than"));
}

// The lens laws of the 4f camera (scene.md): field = m pitch f1/f2, bin = pitch / i / focal f2/f1.
TEST(Cells, optics_make_the_field_and_the_bins_that_were_asked_for) {
    const DesignTask task = small_task("bubble=0.2");
    const CellOptics optics = optics_of(kCell, task.part, task.camera);
    const double lenslets = lenslets_of(kCell, task.camera);
    EXPECT_NEAR(lenslets * optics.lenslet_um * 1e-3 / optics.magnification, task.part.camera.field_mm, 1e-9);
    EXPECT_NEAR(optics.lenslet_um / kCell.bins / optics.focal_um * optics.magnification, kCell.bin_pitch_rad, 1e-12);
}

// A plate's bevels send light to 0.43 rad, beyond every camera's bins. They do not decide its bins, and defects lie
// elsewhere.
TEST(Cells, bevels_do_not_count_as_light_that_bins_must_hold) {
    sim::Scene plate;
    sim::Shape block, bevel, both;
    block.kind = sim::Shape::Kind::block;
    block.half_size_mm = {8, 6, 1};
    bevel.kind = sim::Shape::Kind::half_space;
    bevel.position_mm = {7, 0, 1};
    bevel.rotation_rad = {0, 0.6, 0};
    both.kind = sim::Shape::Kind::intersection;
    both.of = {block, bevel};
    plate.part = sim::SolidPart{both, 1.5};
    const auto survey = PartSurvey::of(plate);
    ASSERT_TRUE(survey);
    ThroughPart way;
    EXPECT_TRUE(way_through(survey->body, 7.5, 0, way));  // there is glass,
    EXPECT_FALSE(survey->holds(7.5, 0, 0.1));             // but none of its light is seen
    EXPECT_TRUE(survey->holds(5, 0, 0.1));
    EXPECT_LT(survey->largest_slope, 1e-6);
}

// The answer names what is missed, and other feature sets of the chosen cell leave room for other cells.
TEST(DesignReport, names_the_sizes_that_are_not_found_and_other_cells) {
    const DesignTask task = small_task("bubble=0.2,scratch=0.03");
    const auto set = [](double ratio) {
        SetTrial out;
        out.found = {{0.1}, {0.06}};
        out.time_ms = 1, out.worst_ratio = ratio, out.holds_rate = true;
        return out;
    };
    Design design;
    design.fine = {{kCell, {}, std::vector(6, set(2))}};
    CellChoice other = kCell;
    other.bins = 7;
    design.coarse = {{other, {}, {set(3)}}};
    design.check.found = {{0.1}, {0.06}};
    design.check.worst_ratio = 2;
    design.check.defects.resize(2);
    const std::string text = describe(design, task);
    EXPECT_THAT(text, HasSubstr("does not find with 90 % probability: scratch of 0.03 mm (a90 0.06 mm), and holds"));
    EXPECT_THAT(text, HasSubstr("7x7 bins"));
    design.coarse.push_back({{5, 0.03, 1, 1.2, 1}, "too wide", {}});
    design.coarse.push_back({{5, 0.03, 1, 0.61, 1}, "too fine", {}});
    const std::string out = describe(design, task);
    EXPECT_THAT(out, HasSubstr("| too wide | 5x5 at 30 mrad with a source of 1.2 bin |"));
    EXPECT_THAT(out, HasSubstr("| too fine | 5x5 at 30 mrad |"));
}

TEST(DesignReport, names_the_optics_of_the_scene_that_a_design_does_not_take) {
    DesignTask task = small_task("bubble=0.2");
    Design design;
    SetTrial set;
    set.found = {{0.1}};
    design.fine = {{kCell, {}, {set}}};
    design.check.found = {{0.1}};
    design.check.defects.resize(1);
    EXPECT_THAT(describe(design, task), ::testing::Not(HasSubstr("Not taken")));
    task.part.camera.main_lens = {100, 600};
    task.part.camera.relay.stop_radius_mm = 2;
    task.part.camera.dust.resize(1);
    EXPECT_THAT(describe(design, task), HasSubstr("whose place the cell takes: main_lens, relay, dust."));
}

TEST(DesignReport, says_whether_the_good_parts_show_the_share_of_rejects_aimed_at) {
    DesignTask task = small_task("bubble=0.2");
    Design design;
    SetTrial set;
    set.found = {{0.1}};
    set.time_ms = 1, set.worst_ratio = 0.5, set.holds_rate = true;
    design.fine = {{kCell, {}, {set}}};
    design.check.found = {{0.1}};
    design.check.worst_ratio = 0.5;
    design.check.defects.resize(1);
    const auto text = [&](int rejected, int good) {
        design.check.rejected = rejected, design.check.good = good;
        return describe(design, task);
    };
    EXPECT_THAT(text(0, 8), HasSubstr("it takes 2995 good parts without a reject. Tune"));
    // One of 8 at 0.64 % or more: p with 1 - (1 - p)^8 = 0.05.
    EXPECT_THAT(text(1, 8), HasSubstr("The aim is missed**: with 95 % confidence 0.64 % or more are rejected. Tune"));
    EXPECT_TRUE(misses_aim(design.check, task.false_rejects));
    EXPECT_THAT(text(0, 2995), ::testing::Not(HasSubstr("The aim")));
}

// The exit status of hord-lab design.
TEST(DesignReport, a_design_meets_its_task_by_rate_sizes_and_false_rejects) {
    const DesignTask task = small_task("bubble=0.2");
    Design design;
    design.check.good = 8, design.check.worst_ratio = 1, design.check.time_ms = 80;
    EXPECT_TRUE(meets(design, task));
    design.check.time_ms = 81;  // 0.8 of a core at 10 parts a second
    EXPECT_FALSE(meets(design, task));
    design.check.time_ms = 1, design.check.worst_ratio = 1.01;
    EXPECT_FALSE(meets(design, task));
    design.check.worst_ratio = kNeverFound;
    EXPECT_FALSE(meets(design, task));
    design.check.worst_ratio = 0.5, design.check.rejected = 1;
    EXPECT_FALSE(meets(design, task));
}

TEST(DesignReport, says_where_the_rate_may_have_decided) {
    const DesignTask task = small_task("bubble=0.2");
    Design design;
    SetTrial set;
    set.found = {{0.1}};
    set.time_ms = 30, set.holds_rate = true;
    design.fine = {{kCell, {}, {set}}};
    design.check.found = {{0.1}};
    design.check.defects.resize(1);
    EXPECT_THAT(describe(design, task), ::testing::Not(HasSubstr("The rate decided")));
    set.time_ms = 100;
    design.coarse = {{kCell, {}, {set}}};
    EXPECT_THAT(describe(design, task), HasSubstr("The rate decided"));
}

TEST(WholeParts, a_pasted_window_is_the_whole_rendering) {
    const DesignTask task = small_task("bubble=0.4");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    sim::Scene whole = good_part(kCell, task, 7, 0);
    const auto clean = sim::render(whole, {1, {}});
    whole.defects = {*make_defect(WantedKind::bubble, 0.4, whole, survey->body, 2, 3, 0)};
    const auto truth = sim::render(whole, {1, {}});
    ASSERT_TRUE(clean && truth);
    const int middle = whole.camera.extents.m / 2;
    const double pitch = whole.camera.field_mm / whole.camera.extents.m;
    const int m = middle + static_cast<int>(std::lround(2 / pitch)),
              n = middle + static_cast<int>(std::lround(3 / pitch));
    const auto window = sim::render(window_of(whole, m, n, 9), {1, {}});
    ASSERT_TRUE(window);
    sim::LightField pasted = *clean;
    paste(pasted, *window, m, n);
    double off = 0, without = 0;
    for (std::size_t k = 0; k < pasted.bins.size(); ++k) {
        off = std::max(off, static_cast<double>(std::abs(pasted.bins[k] - truth->bins[k])));
        without = std::max(without, static_cast<double>(std::abs(clean->bins[k] - truth->bins[k])));
    }
    EXPECT_GT(without, 0.1);  // the bubble is there,
    EXPECT_LT(off, 0.01);     // and nowhere else
}

TEST(WholeParts, for_the_limits_lie_in_every_part_of_a_lenslet) {
    const DesignTask task = small_task("bubble=0.4");
    for (const int count : {1, 2, 8, 16, 20}) {
        std::set<int> x, y;
        for (int k = 0; k < count; ++k) {
            const sim::Scene scene = spread_part(kCell, task, k, count);
            const double pitch = scene.camera.field_mm / scene.camera.extents.m;
            const auto part = [&](double at_mm) { return static_cast<int>(std::floor((at_mm / pitch + 0.5) * count)); };
            x.insert(part(scene.pose.x_mm));
            y.insert(part(scene.pose.y_mm));
        }
        EXPECT_EQ(static_cast<int>(x.size()), count);
        EXPECT_EQ(static_cast<int>(y.size()), count);
        EXPECT_EQ(*x.begin(), 0);
        EXPECT_EQ(*y.begin(), 0);
    }
}

TEST(CellTrials, larger_defects_are_found_and_the_size_found_lies_between) {
    const DesignTask task = small_task("speck=0.4");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    const auto trial = try_cell(kCell, task, *survey, {2, 2, 2});
    ASSERT_TRUE(trial) << trial.error().message();
    ASSERT_FALSE(trial->sets.empty());
    const SetTrial& best = trial->sets.front();
    EXPECT_TRUE(best.set.light);
    EXPECT_LE(best.worst_ratio, 1.0);
    EXPECT_GT(best.found[0].a90_mm, 0);
    EXPECT_GT(best.time_ms, 0);
    // A speck of a hundredth of a lenslet's area takes less light than noise moves.
    DesignTask tiny = task;
    tiny.defects = *parse_defects("speck=0.01");
    const auto missed = try_cell(kCell, tiny, *survey, {2, 2, 2});
    ASSERT_TRUE(missed);
    EXPECT_GT(missed->sets.front().worst_ratio, 1.0);
}

TEST(CellTrials, a_slow_set_is_not_chosen_whatever_it_finds) {
    SetTrial fast, slow;
    fast.holds_rate = true, fast.worst_ratio = 0.9, fast.time_ms = 10;
    slow.holds_rate = false, slow.worst_ratio = 0.3, slow.time_ms = 500;
    EXPECT_TRUE(is_better(fast, slow));
    EXPECT_FALSE(is_better(slow, fast));
    slow.holds_rate = true;
    EXPECT_TRUE(is_better(slow, fast));
}

// Times differ with what else the machine does.
TEST(CellTrials, of_equal_sets_the_one_with_less_counted_work_is_chosen_whatever_the_times_were) {
    const algo::Extents extents{111, 111, 9, 9};
    const auto sets = judged_sets();
    SetTrial light, emd;
    light.set = sets.front(), emd.set = sets.back();
    for (SetTrial* of : {&light, &emd})
        of->holds_rate = true, of->worst_ratio = 0.5, of->work = work_of(of->set, extents);
    EXPECT_GT(emd.work, 1.3 * light.work);
    for (const double time_ms : {0.1, 10.0}) {
        light.time_ms = time_ms, emd.time_ms = 1;
        EXPECT_TRUE(is_better(light, emd));
        EXPECT_FALSE(is_better(emd, light));
    }
    light.work = emd.work;
    EXPECT_FALSE(is_better(light, emd));
    EXPECT_FALSE(is_better(emd, light));
}

// Many lenslets of few bins take longer than fewer lenslets of more bins, though they read as many.
TEST(CellTrials, lenslets_count_beside_their_bins) {
    const auto sets = judged_sets();
    EXPECT_GT(work_of(sets[0], {471, 471, 3, 3}), 2 * work_of(sets[1], {281, 281, 5, 5}));
    EXPECT_GT(work_of(sets[0], {281, 281, 9, 9}), work_of(sets[0], {281, 281, 5, 5}));
}

// Dark places in good parts, such as bevels, leave no room for a limit of the light.
TEST(CellTrials, a_limit_beyond_all_light_does_not_switch_the_light_off) {
    PartValues limits{};
    limits[kLightValue] = 1.02;
    const algo::Recipe recipe = recipe_of({{}, false, true}, limits, {});
    EXPECT_GT(recipe.transmission_limit, 0);
    EXPECT_TRUE(algo::problems(recipe, {31, 31, 9, 9}).empty());
}

// Bevels of three lenslets are wider than the default margin of the rim. Their dark lenslets would leave no limit for
// the light.
TEST(WholeParts, of_plates_with_dark_bevels_get_a_wider_rim_and_a_limit_for_the_light) {
    DesignTask task;
    task.part.name = "plate";
    sim::Shape plate, block;
    block.kind = sim::Shape::Kind::block;
    block.half_size_mm = {8, 6, 1};
    plate.kind = sim::Shape::Kind::intersection;
    plate.of = {block};
    for (const double side : {-1.0, 1.0}) {  // at 45 degrees, 0.9 mm wide
        sim::Shape bevel;
        bevel.kind = sim::Shape::Kind::half_space;
        bevel.position_mm = {7.1 * side, 0, 1}, bevel.rotation_rad = {0, 0.7853981634 * side, 0};
        plate.of.push_back(bevel);
        bevel.position_mm = {0, 5.1 * side, 1}, bevel.rotation_rad = {-0.7853981634 * side, 0, 0};
        plate.of.push_back(bevel);
    }
    task.part.part = sim::SolidPart{plate, 1.5};
    task.part.effects.fresnel = true;  // else nothing tells the plate from its edges
    task.base.form = algo::PartForm::plate;
    task.base.symmetric_outline = false;
    task.camera.pixels = 395.0 * 395.0;  // 79x79 lenslets of 0.3 mm
    task.camera.pixel_um = 20;
    task.defects = *parse_defects("speck=0.6");
    task.threads = 1;
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    const std::function<void(double)> unheard = [](double) {};
    const auto check = check_whole_parts(kCell, {{{}, false, true}, {}, {}, 0, 0, false}, task, *survey,
                                         {2, 1, 4, 2, {2, 1, 1}}, unheard);
    ASSERT_TRUE(check) << check.error().message();
    EXPECT_GT(check->recipe.rim_margin, 2);
    EXPECT_GT(check->recipe.transmission_limit, 0.7F);
    EXPECT_EQ(check->rejected, 0);
    EXPECT_EQ(check->defects[0].wanted.found, 2);
}

// A wedge bends light out of the lenslets beside its edge. Limits that allow for it would allow for defects, too.
TEST(WholeParts, of_wedges_get_a_rim_beyond_the_light_that_their_edge_bends) {
    DesignTask task;
    sim::Wedge wedge;
    wedge.half_size_mm = 3;
    wedge.tilt_x_rad = 0.06, wedge.tilt_y_rad = 0.034;
    wedge.tilts_source_side = true;
    task.part.part = wedge;
    task.part.camera.field_mm = 9;
    task.base.form = algo::PartForm::plate;
    task.camera.pixels = 525.0 * 525.0;  // 105x105 lenslets of 0.086 mm
    task.defects = *parse_defects("speck=0.2");
    task.threads = 1;
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    const std::function<void(double)> unheard = [](double) {};
    const auto check = check_whole_parts({5, 0.03, 1, 1.2, 1}, {{{}, true, true}, {}, {}, 0, 0, false}, task, *survey,
                                         {3, 1, 4, 1, {1, 1, 1}}, unheard);
    ASSERT_TRUE(check) << check.error().message();
    EXPECT_GT(check->recipe.rim_margin, 2);
    EXPECT_LT(check->recipe.frobenius_limit_bins, 0.1F);  // 0.9 beside the edge
}

// What was asked as round is judged as no part: the form is the one in which a good part is judged.
TEST(DesignTasks, take_the_form_in_which_a_good_part_is_judged) {
    for (const auto& [scene, form] :
         {std::pair("plate", algo::PartForm::plate), std::pair("lens", algo::PartForm::round)}) {
        DesignTask task;
        task.part = sim::load_scene(HORD_SOURCE_DIR "/hal_sim/scenes/" + std::string(scene) + ".toml").value();
        task.base.symmetric_outline = !std::holds_alternative<sim::SolidPart>(task.part.part);
        task.camera.pixels = 4e5;
        task.threads = 1;
        const auto survey = PartSurvey::of(task.part);
        ASSERT_TRUE(survey);
        EXPECT_EQ(form_of(task, *survey, {}), form) << scene;
    }
}

TEST(DesignTasks, with_a_part_that_the_edge_of_the_field_cuts_are_refused_and_webs_fill_the_field) {
    sim::Scene part;
    part.camera.field_mm = 24;
    part.part = sim::Plate{8, 2};
    EXPECT_FALSE(PartSurvey::of(part)->fills_field);
    part.pose.x_mm = 5;
    const auto cut = PartSurvey::of(part);
    ASSERT_FALSE(cut);
    EXPECT_THAT(cut.error().message(), HasSubstr("beyond the field of 24 mm"));
    DesignTask task;
    task.part = part;
    task.part.part = sim::Plate{20, 2};
    task.defects = *parse_defects("scratch=0.1");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    EXPECT_TRUE(survey->fills_field);
    EXPECT_THAT(check_task(task, *survey).error().message(), HasSubstr("--form web"));
    task.base.form = algo::PartForm::web;
    EXPECT_TRUE(check_task(task, *survey));
}

TEST(DesignTasks, with_a_rate_that_no_station_times_are_refused) {
    DesignTask task = small_task("bubble=0.2");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    task.rate = kHighestRate;
    EXPECT_TRUE(check_task(task, *survey));
    task.rate = 180;
    EXPECT_THAT(check_task(task, *survey).error().message(), HasSubstr("give --rate 173 or less"));
}

// A sharp plate has no dark edges: the station sees no part.
TEST(DesignTasks, with_parts_that_are_unfit_end_before_the_search) {
    DesignTask task;
    task.part.part = sim::Plate{4, 1};
    task.part.camera.field_mm = 12;
    task.base.form = algo::PartForm::plate;
    task.camera.pixels = 400.0 * 400.0;
    task.defects = *parse_defects("scratch=0.2");
    task.threads = 1;
    DesignOptions options;
    options.quick = true;
    std::vector<double> progress;
    options.progress = [&](double done, const std::string&) { progress.push_back(done); };
    const auto design = design_cell(task, options);
    ASSERT_FALSE(design);
    EXPECT_THAT(design.error().message(), HasSubstr("no-part"));
    EXPECT_THAT(design.error().cure, HasSubstr("bevels"));
    EXPECT_THAT(progress, ::testing::Each(0));
    EXPECT_TRUE(check_good_part({5, 0.03, 1, 0.61, 1}, small_task("bubble=0.2")));
}

TEST(DesignTasks, with_bubbles_thicker_than_the_glass_are_refused) {
    DesignTask task;
    task.part.part = sim::Plate{8, 0.3};
    task.defects = *parse_defects("bubble=0.5");
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    EXPECT_NEAR(survey->thickest_mm, 0.3, 1e-9);
    EXPECT_THAT(check_task(task, *survey).error().message(), HasSubstr("bubble=0.5 does not fit"));
    task.defects = *parse_defects("bubble=0.2,dimple=0.5");
    EXPECT_TRUE(check_task(task, *survey));
}

TEST(CellTrials, hollow_parts_are_refused_with_a_cure) {
    sim::Scene vial;
    vial.part = sim::Vial{};
    const auto refused = PartSurvey::of(vial);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message(), HasSubstr("one solid body"));
}

}  // namespace
}  // namespace hord::lab
