// Starts that cannot succeed until a person changes something: status 78, with key, file and cure, before anything is
// rendered; and what a start tells of recipes that cannot be selected.
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "calib/files/grid_toml.h"
#include "drivers/files/frame_file.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class RefusedStart : public Service {
  protected:
    void SetUp() override { std::filesystem::create_directories(empty); }
    void configure(const std::string& text) {
        std::ofstream(folder / "c.toml") << simulated_beside("[modbus]\nport = 0\n" + text);
    }
    // `says`: all that the message must have. The start, --check and hordctl run say the same.
    template <class Says>
    void refused(const Says& says) {
        const Said start = run("/usr/bin/env", under({"CACHE_DIRECTORY=" + empty.string()}));
        EXPECT_EQ(start.status, 78) << start.err;
        EXPECT_THAT(start.err, says);
        EXPECT_TRUE(std::filesystem::is_empty(empty)) << "a cell was rendered";
        const Said check = run("/usr/bin/env", under({}, {"--check"}));
        EXPECT_EQ(check.status, 78) << check.err;
        EXPECT_THAT(check.err, says);
        EXPECT_EQ(check.err, start.err) << "--check says it twice, or in other words";
        const Said line = run("hordctl", {"run", "--config", folder / "c.toml", "--parts", "1"});
        EXPECT_EQ(line.status, 2);
        EXPECT_THAT(line.err, AllOf(says, Not(HasSubstr("render"))));
    }

    const std::filesystem::path empty = folder / "empty";
};

TEST_F(RefusedStart, on_a_folder_without_a_frame_and_says_what_to_do_if_it_is_mounted_later) {
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"empty\"\n");
    const std::string later = "if it is mounted later: systemctl edit hordd, [Unit] RequiresMountsFor=";
    const auto mounted = HasSubstr(later);
    refused(AllOf(HasSubstr("sensor.folder: the folder " + empty.string() + " holds no frame"), mounted));
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"none\"\n");
    refused(AllOf(HasSubstr("sensor.folder: " + (folder / "none") + " does not exist"), mounted));
    std::filesystem::create_symlink("/nonexistent/x", folder / "link");
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"link\"\n");
    refused(AllOf(HasSubstr("sensor.folder: " + (folder / "link") + " is a symbolic link to /nonexistent/x"),
                  HasSubstr(later + "/nonexistent/x")));
}

TEST_F(RefusedStart, on_frames_that_are_none_or_of_other_macro_pixels) {
    std::filesystem::create_directories(folder / "frames/sub.png");
    EXPECT_TRUE(drivers::write_frame(folder / "frames/a.png", Frame(27, 27, 8).view()));
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    refused(HasSubstr("sensor.folder: " + (folder / "frames/sub.png") +
                      " is a folder, and its name is a frame's: rename it"));
    std::filesystem::remove(folder / "frames/sub.png");
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n[inspection]\nmacro = \"5x5\"\n");
    refused(
        AllOf(HasSubstr("sensor.folder: the frames of " + (folder / "frames") + ": macro-pixels of 5x5 do not divide"),
              HasSubstr("inspection.macro")));
    const drivers::FrameGeometry five{drivers::FrameKind::macro_pixels, {9, 9, 3, 3}, 8};
    EXPECT_TRUE(drivers::write_frame(folder / "frames/a.png", Frame(27, 27, 8).view(), five));
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    refused(AllOf(HasSubstr("sensor.folder: " + (folder / "frames/a.png") + " says macro-pixels of 3x3 bins"),
                  HasSubstr("set inspection.macro = \"3x3\"")));
}

TEST_F(RefusedStart, on_any_recorded_frame_that_cannot_be_played) {
    const std::filesystem::path frames = folder / "frames";
    std::filesystem::create_directories(frames);
    for (const char* good : {"a.png", "b.png"})
        EXPECT_TRUE(drivers::write_frame(frames / good, Frame(45, 45, 8).view()));
    EXPECT_TRUE(drivers::write_frame(frames / "c.png", Frame(54, 45, 8).view()));
    EXPECT_TRUE(drivers::write_frame(frames / "d.png", Frame(45, 45, 16).view()));
    std::filesystem::copy_file(frames / "a.png", frames / "e.png");
    std::filesystem::resize_file(frames / "e.png", std::filesystem::file_size(frames / "e.png") - 20);
    std::filesystem::create_symlink("/nonexistent/f.png", frames / "f.png");
    ASSERT_EQ(::mkfifo((frames / "g.png").c_str(), 0600), 0);
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    const auto of = [&](const char* name) { return "sensor.folder: " + (frames / name).string(); };
    refused(AllOf(HasSubstr(of("c.png") + " is 54x45 pixels, and the frames before it 45x45: play frames of one size"),
                  HasSubstr(of("d.png") + " has 16-bit samples, and the frames before it 8: play frames of one depth"),
                  HasSubstr(of("e.png") + " is truncated"),
                  HasSubstr(of("f.png") + " is a symbolic link to /nonexistent/f.png, which does not exist"),
                  HasSubstr(of("g.png") + " is a pipe, not a regular file")));
}

TEST_F(RefusedStart, on_many_frames_names_the_first_and_how_many_they_are) {
    std::filesystem::create_directories(folder / "frames");
    for (int k = 100; k < 130; ++k) std::ofstream(folder / ("frames/" + std::to_string(k) + ".png")) << "no picture";
    configure("[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    refused(AllOf(HasSubstr("sensor.folder: 30 frames cannot be played; the first 10:\n"), HasSubstr("109.png"),
                  Not(HasSubstr("110.png")),
                  HasSubstr("sensor.folder: and 20 more: mend these and start again: it tells the next ones\n")));
}

TEST_F(RefusedStart, on_frames_of_another_size_or_depth_than_the_configuration_names) {
    std::filesystem::create_directories(folder / "frames");
    EXPECT_TRUE(drivers::write_frame(folder / "frames/a.png", Frame(45, 54, 12).view()));
    const std::string frames = "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n";
    const std::string are = ", and the frames of " + (folder / "frames") + " are 45x54: set sensor.";
    configure(frames + "width_px = 54\n");
    refused(HasSubstr("sensor.width_px = 54" + are + "width_px = 45, or"));
    configure(frames + "height_px = 45\n");
    refused(HasSubstr("sensor.height_px = 45" + are + "height_px = 54, or"));
    configure(frames + "bits = 8\n");
    refused(HasSubstr("a.png has 16-bit samples, expected 8: say how many bits the samples have (sensor.bits"));
    configure(frames + "bits = 12\nwidth_px = 45\nheight_px = 54\n");
    const Said check = run("/usr/bin/env", under({}, {"--check"}));
    EXPECT_EQ(check.status, 0) << check.err;
}

// 10-bit samples read as 12 would be four times too dark, and a sensor's dark level in the wrong place.
TEST_F(RefusedStart, on_frames_whose_note_says_another_depth_than_the_configuration) {
    std::filesystem::create_directories(folder / "frames");
    const drivers::FrameGeometry ten{drivers::FrameKind::macro_pixels, {5, 5, 9, 9}, 10};
    EXPECT_TRUE(drivers::write_frame(folder / "frames/b.png", Frame(45, 45, 10).view(), ten));
    const std::string frames = "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n";
    const std::string note = "sensor.folder: " + (folder / "frames/b.png") + " says macro-pixels of 9x9 bins, 5x5 ";
    for (const int bits : {8, 12, 16}) {
        configure(frames + "bits = " + std::to_string(bits) + "\n");
        refused(HasSubstr(note + "lenslets, 10 bits, and sensor.bits is " + std::to_string(bits) +
                          ": leave sensor.bits out (the depth is then 10)"));
    }
    for (const char* fits : {"", "bits = 10\n"}) {
        configure(frames + fits);
        const Said check = run("/usr/bin/env", under({}, {"--check"}));
        EXPECT_EQ(check.status, 0) << check.err;
    }
}

TEST_F(RefusedStart, on_frames_of_16_bits_of_which_nobody_says_how_many_count) {
    std::filesystem::create_directories(folder / "frames");
    const std::string frames = "[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n";
    const std::string unsaid = "sensor.folder: the frames of " + (folder / "frames") +
        " have 16-bit samples, nothing says how many of the bits count, and the largest sample is ";
    const auto play = [&](std::uint32_t largest, const std::string& bits) {
        Frame frame(45, 45, 16);
        EXPECT_TRUE(drivers::write_frame(folder / "frames/a.png", frame.view()));
        frame.set(40, 31, largest);
        EXPECT_TRUE(drivers::write_frame(folder / "frames/b.png", frame.view()));
        configure(frames + bits);
    };
    const auto goes = [&] {
        const Said check = run("/usr/bin/env", under({}, {"--check"}));
        EXPECT_EQ(check.status, 0) << check.err;
    };
    play(900, "");
    refused(HasSubstr(unsaid + "900, which 10 bits hold: set sensor.bits to the sensor's depth: 10 or 12; 16 if all"));
    play(4095, "");
    refused(HasSubstr(unsaid + "4095, which 12 bits hold: set sensor.bits to the sensor's depth: 12; 16 if all"));
    play(16383, "");
    refused(HasSubstr(unsaid + "16383, which 14 bits hold: set sensor.bits to the sensor's depth: 16, with saturated"));
    play(16384, "");
    goes();
    play(16383, "bits = 16\n");
    goes();
    play(1024, "bits = 10\n");
    refused(HasSubstr("sensor.folder: " + (folder / "frames/b.png") +
                      " has a sample of 1024 at (40,31), more than 10 "
                      "bits hold: say how many bits the samples really have (sensor.bits"));
}

TEST_F(RefusedStart, on_scenes_that_are_none_or_of_other_macro_pixels) {
    configure("[sensor]\nbackend = \"simulated\"\nscenes = \"empty\"\n");
    refused(HasSubstr("sensor.scenes: " + empty.string() + " has no scene"));
    std::filesystem::create_directories(folder / "scenes");
    std::filesystem::copy_file(std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes/lens.toml",
                               folder / "scenes/good.toml");
    configure("[sensor]\nbackend = \"simulated\"\nscenes = \"scenes\"\n[inspection]\nmacro = \"3x3\"\n");
    refused(AllOf(HasSubstr("sensor.scenes: the scenes of " + (folder / "scenes") + " have 9x9 bins"),
                  HasSubstr("set inspection.macro = \"9x9\"")));
    std::ofstream(folder / "scenes/idle.toml") << "idle = 1\n";
    configure("[sensor]\nbackend = \"simulated\"\nscenes = \"scenes\"\n");
    refused(AllOf(HasSubstr("sensor.scenes: "), HasSubstr("idle.toml")));
}

TEST_F(RefusedStart, on_a_calibration_of_frames_of_another_size) {
    calib::GridFile file;
    file.grid.columns = 20;
    file.grid.rows = 18;
    file.grid.width_px = 320;
    file.grid.height_px = 288;
    file.grid.parameters = {7.5, 7.5, 16, 0};
    file.stamp = {"one", "2026-01-31T12:00:00Z", "white.png", ""};
    file.statistics.complete = file.statistics.found = 360;
    file.statistics.blocks = 25;
    ASSERT_TRUE(calib::write_grid(folder / "grid.toml", file));
    const std::string sizes =
        (folder / "grid.toml") + ": a calibration of frames of 320x288 px, but the sensor's are of ";
    configure("[inspection]\nmacro = \"8x8\"\ngrid = \"grid.toml\"\n");
    refused(AllOf(HasSubstr(sizes + "888x888"), HasSubstr("name its calibration in inspection.grid")));
    std::filesystem::create_directories(folder / "frames");
    EXPECT_TRUE(drivers::write_frame(folder / "frames/a.png", Frame(64, 64, 8).view()));
    configure(
        "[inspection]\nmacro = \"8x8\"\ngrid = \"grid.toml\"\n[sensor]\nbackend = \"frames\"\nfolder = \"frames\"\n");
    refused(HasSubstr(sizes + "64x64"));
}

TEST_F(RefusedStart, on_a_calibration_that_cannot_be_used_and_names_its_key) {
    const std::string another = "; or name another calibration (hordctl calibrate makes one)";
    const auto grid = [&](const std::string& name) {
        configure("[inspection]\nmacro = \"8x8\"\ngrid = \"" + name + "\"\n");
        return "inspection.grid: " + (folder / name);
    };
    refused(HasSubstr(grid("empty") + ": cannot be read (Is a directory): give a file of this folder" + another));
    refused(HasSubstr(grid("none.toml") + ": cannot be read (No such file or directory): check"));
    std::ofstream(folder / "text.toml") << "schema = 1\n";
    refused(AllOf(HasSubstr(grid("text.toml") + ":1: no checksum: "), HasSubstr(another)));
}

TEST_F(RefusedStart, on_a_recipe_or_a_calibration_that_is_not_there_and_may_be_mounted_later) {
    for (const std::string key : {"recipe", "grid"}) {
        configure("[inspection]\nmacro = \"3x3\"\n" + key + " = \"gone.toml\"\n");
        refused(AllOf(HasSubstr("inspection." + key + ": " + (folder / "gone.toml") + ": cannot be read (No such file"),
                      HasSubstr("if it is mounted later: systemctl edit hordd, [Unit] RequiresMountsFor=" +
                                (folder / "gone.toml"))));
    }
}

TEST_F(RefusedStart, on_a_recipe_that_does_not_fit_the_light_field) {
    std::ofstream(folder / "wide.toml") << "schema = 1\nname = \"wide\"\nnumber = 7\nrim_margin = 60\n";
    configure("[inspection]\nmacro = \"3x3\"\nrecipe = \"wide.toml\"\n");
    refused(AllOf(HasSubstr("inspection.recipe: " + (folder / "wide.toml")), HasSubstr("rim_margin 60")));
}

// Neither keeps the line from running; both would first show when a PLC selects a recipe.
TEST_F(RefusedStart, is_none_for_recipes_that_cannot_be_selected_and_they_are_told) {
    std::ofstream(folder / "recipes") << "x";  // that no key names: told unless it does not exist
    write_config("[station]\nautostart = false\n");
    {
        Running no_folder("/usr/bin/env", under({}));
        EXPECT_TRUE(no_folder.says("the folder of recipes " + (folder / "recipes") + ": Not a directory", kPatience))
            << no_folder.so_far().err;
    }
    std::filesystem::remove(folder / "recipes");
    std::filesystem::create_directories(folder / "recipes");
    for (const char* name : {"a.toml", "b.toml"})
        std::ofstream(folder / ("recipes/" + std::string(name))) << "schema = 1\nnumber = 7\n[limits]\nemd_bins = 1\n";
    write_config("[station]\nautostart = false\n");
    {
        Running doubled("/usr/bin/env", under({}));
        EXPECT_TRUE(
            doubled.says("a.toml and " + (folder / "recipes/b.toml") + " both have number 7: give each", kPatience))
            << doubled.so_far().err;
    }
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[station]\nautostart = false\n[inspection]\nmacro = \"3x3\"\nrecipes = \"gone\"\n[modbus]\nport = 0\n");
    Running missing("/usr/bin/env", under({}));
    EXPECT_TRUE(missing.says("the folder of recipes " + (folder / "gone") + ": No such file", kPatience))
        << missing.so_far().err;
}

// The station starts with it, as with any store: fault `store`.
TEST_F(RefusedStart, is_none_for_a_store_that_is_no_file_and_check_refuses_it) {
    const auto store = folder.path() / "store", file = store / "results.db";
    write_config("[store]\nfolder = \"" + store.string() + "\"\n");
    const auto checked = [&](const std::string& says) {
        const Said check = run("/usr/bin/env", under({}, {"--check"}));
        EXPECT_EQ(check.status, 78) << check.err;
        EXPECT_THAT(check.err, HasSubstr(file.string() + says));
        std::filesystem::remove(file);
    };
    std::filesystem::create_directories(file);
    checked(" is a folder, not a regular file: move it out of the folder");
    std::filesystem::create_symlink("/nonexistent/r.db", file);
    checked(" is a symbolic link to /nonexistent/r.db, which does not exist: make the folder that it leads to");
    ASSERT_EQ(::mkfifo(file.c_str(), 0600), 0);
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"results"}, std::vector<std::string>{"results", "verify"}}) {
        std::vector<std::string> arguments = command;
        arguments.insert(arguments.end(), {"--store", store.string()});
        const Said read = run("hordctl", arguments);
        EXPECT_EQ(read.status, 2) << read.err;
        EXPECT_THAT(read.err, HasSubstr(file.string() + " is a pipe, not a regular file: move it out of the folder"));
    }
    checked(" is a pipe, not a regular file: move it out of the folder");
}

// The first reject found it: fault `pictures`.
TEST_F(RefusedStart, is_none_for_a_folder_of_frames_that_is_none_and_check_refuses_it) {
    const auto store = folder.path() / "store", frames = store / "frames";
    std::filesystem::create_directories(store);
    const auto checked = [&](int frames_mb) {
        write_config("[store]\nfolder = \"" + store.string() + "\"\nframes_mb = " + std::to_string(frames_mb) + "\n");
        return run("/usr/bin/env", under({}, {"--check"}));
    };
    EXPECT_EQ(checked(10).status, 0) << "the station makes it";
    const auto refused = [&](const std::string& says) {
        const Said check = checked(10);
        EXPECT_EQ(check.status, 78) << check.out;
        EXPECT_THAT(check.err, HasSubstr(frames.string() + says));
        EXPECT_EQ(checked(0).status, 0) << "no frame is kept";
        std::filesystem::remove(frames);
    };
    ASSERT_EQ(::mkfifo(frames.c_str(), 0600), 0);
    refused(" is a pipe, not a folder: move it away");
    std::ofstream(frames) << "x";
    refused(" is a file, not a folder: move it away");
    std::filesystem::create_symlink("/nonexistent/frames", frames);
    refused(" is a symbolic link to /nonexistent/frames, which does not exist");
}

// `recipe use` refused it, and --check had said nothing.
TEST_F(RefusedStart, is_none_for_a_recipe_that_does_not_fit_the_frames_and_check_names_it) {
    std::filesystem::create_directories(folder / "recipes");
    const std::string fits = folder / "recipes/fits.toml", wide = folder / "recipes/wide.toml";
    std::ofstream(fits) << "schema = 1\nnumber = 7\nrim_margin = 1\n[limits]\nemd_bins = 1\n";
    std::ofstream(wide) << "schema = 1\nname = \"wide\"\nnumber = 8\nrim_margin = 60\n[limits]\nemd_bins = 1\n";
    write_config("[station]\nautostart = false\n");
    const Said check = run("/usr/bin/env", under({}, {"--check"}));
    EXPECT_EQ(check.status, 0) << check.err;
    EXPECT_THAT(check.out,
                HasSubstr("note: a recipe that cannot be selected: " + wide + ": recipe \"wide\": rim_margin 60"));
    EXPECT_THAT(check.out, Not(HasSubstr("cannot be selected: " + fits)));
}

}  // namespace
}  // namespace hord::test
