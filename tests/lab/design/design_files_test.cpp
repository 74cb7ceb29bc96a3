// What a design writes is what the station and the simulated line read, and it judges as the design says.
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "algo/inspection/pipeline.h"
#include "firmware/config/config.h"
#include "firmware/recipes/recipe_file.h"
#include "hal_sim/cell/scene_folder.h"
#include "hal_sim/optics/camera/render.h"
#include "lab/design/design.h"

namespace hord::lab {
namespace {

class DesignFiles : public ::testing::Test {
  protected:
    DesignFiles() : folder(std::filesystem::temp_directory_path() / ("hord-design-" + std::to_string(::getpid()))) {
        std::filesystem::create_directories(folder);
        std::ofstream(folder / "part.toml") << "name = \"lens\"\n[part]\nkind = \"double-convex\"\n"
                                               "aperture_radius_mm = 9\n[pose]\nrotation_rad = 0.1\n";
    }
    ~DesignFiles() override { std::filesystem::remove_all(folder); }
    std::filesystem::path folder;
};

TEST_F(DesignFiles, run_as_they_are_and_judge_as_the_design_says) {
    DesignTask task;
    task.part = *sim::load_scene(folder / "part.toml");
    task.camera.pixels = 275.0 * 275.0;
    task.camera.pixel_um = 20;
    task.defects = *parse_defects("bubble=0.5,speck=0.5");
    task.threads = 1;
    const auto survey = PartSurvey::of(task.part);
    ASSERT_TRUE(survey);
    Design design;
    auto trial = try_cell({5, 0.04, 1, 0.61, 1}, task, *survey, {2, 2, 1});
    ASSERT_TRUE(trial) << trial.error().message();
    design.fine.push_back(*trial);
    design.coarse.push_back(std::move(*trial));
    double done = 0;
    auto check = check_whole_parts(design.fine[0].cell, design.fine[0].sets[0], task, *survey, {4, 2, 4, 2, {2, 2, 1}},
                                   [&](double now) { done = now; });
    ASSERT_TRUE(check) << check.error().message();
    EXPECT_EQ(check->good, 8);
    EXPECT_EQ(check->rejected, 0);
    for (const DefectCheck& defect : check->defects) EXPECT_EQ(defect.wanted.found, defect.wanted.tried);
    EXPECT_GT(done, 0.5);
    design.check = std::move(*check);
    EXPECT_THAT(describe(design, task), ::testing::HasSubstr("Build: 5x5 bins of 40 mrad"));

    std::filesystem::create_directories(folder / "out" / "scenes");
    std::ofstream(folder / "out" / "scenes" / "cut-9.toml") << "left by an earlier design";
    const auto files = write_design(folder / "out", folder / "part.toml", design, task, *survey);
    ASSERT_TRUE(files) << files.error().message();
    const auto config = firmware::load_config(folder / "out" / "hordd.toml");
    ASSERT_TRUE(config) << config.error().message();
    task.rate = kHighestRate;  // the files of the fastest line are a station's, too
    ASSERT_TRUE(write_design(folder / "fast", folder / "part.toml", design, task, *survey));
    const auto fast = firmware::load_config(folder / "fast" / "hordd.toml");
    EXPECT_TRUE(fast) << fast.error().message();
    const auto recipe = firmware::load_numbered_recipe(config->inspection.recipe);
    ASSERT_TRUE(recipe) << recipe.error().message();
    const auto parts = sim::load_production(std::get<firmware::SimulatedSensor>(config->sensor).scenes, 0.7);
    ASSERT_TRUE(parts) << parts.error().message();
    ASSERT_EQ(parts->scenes.size(), 4U);  // two good ones, one of each defect
    for (std::size_t k = 0; k < parts->scenes.size(); ++k) {
        const sim::Scene& scene = parts->scenes[k];
        EXPECT_EQ(scene.pose.rotation_rad, 0.1);
        EXPECT_EQ(std::get<sim::DoubleConvexLens>(scene.part).aperture_radius_mm, 9);
        EXPECT_EQ(scene.camera.extents.i, config->inspection.bins_i);
        const auto light = sim::render(scene, {1, {}});
        ASSERT_TRUE(light);
        const Frame frame = sim::expose(*light, scene, 99);
        auto pipeline = algo::Pipeline::create(scene.camera.extents, frame.bits(), recipe->recipe);
        ASSERT_TRUE(pipeline);
        const auto found = pipeline->inspect(frame.view());
        ASSERT_TRUE(found);
        EXPECT_EQ(found->verdict, parts->kinds[k].bad ? algo::Verdict::reject : algo::Verdict::pass)
            << scene.name << " " << name_of(found->reason) << " " << found->score;
    }
}

TEST_F(DesignFiles, kinds_and_shares_of_a_folder_come_from_the_names) {
    std::filesystem::remove(folder / "part.toml");
    for (const char* name : {"good-1", "good-2", "bubble-1", "deep-cut-12"})
        std::ofstream(folder / (std::string(name) + ".toml")) << "[camera]\nm = 31\nn = 31\n";
    const auto parts = sim::load_production(folder, 0.8);
    ASSERT_TRUE(parts) << parts.error().message();
    std::vector<std::string> kinds;
    double good = 0, all = 0;
    for (const sim::PartKind& kind : parts->kinds) {
        kinds.push_back(kind.name);
        EXPECT_EQ(kind.bad, kind.name != "good");
        good += kind.bad ? 0 : kind.share;
        all += kind.share;
    }
    EXPECT_THAT(kinds, ::testing::ElementsAre("bubble", "deep-cut", "good", "good"));
    EXPECT_DOUBLE_EQ(good, 0.8);
    EXPECT_DOUBLE_EQ(all, 1);
    std::ofstream(folder / "other-1.toml") << "[camera]\nm = 33\nn = 33\n";
    EXPECT_FALSE(sim::load_production(folder, 0.8));
    EXPECT_FALSE(sim::load_production(folder / "none", 0.8));
}

}  // namespace
}  // namespace hord::lab
