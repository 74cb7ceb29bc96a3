// The folders that a configuration names: there, to be created, or impossible, each with its key.
#include "firmware/config/path_check.h"

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;
using testing_support::TempFolder;

class FolderCheck : public testing::Test {
  protected:
    FolderCheck() {
        config_.file = root_.path() / "hordd.toml";
        config_.inspection.recipes = root_.path() / "recipes";
    }
    std::string problem() const {
        const auto checked = check_folders(config_);
        return checked ? "none" : checked.error().message();
    }
    std::vector<std::string> good() const {
        return check_folders(config_).value_or(std::vector<std::string>{"refused"});
    }

    TempFolder root_;
    Config config_;
};

TEST_F(FolderCheck, a_store_is_there_or_can_be_created_and_which_is_said) {
    EXPECT_THAT(good(), IsEmpty()) << "without a folder the store is in the state folder";
    config_.store.folder = root_.path() / "store";
    EXPECT_THAT(good(), ElementsAre(AllOf(HasSubstr("store.folder"), HasSubstr("may create it"))));
    EXPECT_FALSE(fs::exists(config_.store.folder));
    fs::create_directory(config_.store.folder);
    EXPECT_THAT(good(), ElementsAre(HasSubstr("may write it")));
    config_.store.folder += "/";
    EXPECT_THAT(good(), ElementsAre(HasSubstr("may write it")));
}

TEST_F(FolderCheck, the_store_in_the_state_folder_is_looked_at_once_it_is_there) {
    config_.state_folder = root_.path();
    EXPECT_THAT(good(), ElementsAre(HasSubstr("$STATE_DIRECTORY"))) << "the first start makes it";
    fs::create_symlink("/nonexistent/x", root_.path() / "store");
    EXPECT_THAT(problem(),
                AllOf(HasSubstr("store.folder (not set: in $STATE_DIRECTORY): "),
                      HasSubstr("is a symbolic link to /nonexistent/x, which")));
    fs::remove(root_.path() / "store");
    root_.write("store", "x");
    EXPECT_THAT(problem(), HasSubstr("store is not a folder"));
    config_.store.enabled = false;
    EXPECT_EQ(problem(), "none");
}

TEST_F(FolderCheck, what_the_kernel_shows_as_files_holds_no_store) {
    config_.store.folder = "/proc/hord";
    EXPECT_THAT(problem(), HasSubstr("/proc/hord cannot be created: /proc cannot hold files"));
    config_.store.folder = "/proc";
    EXPECT_THAT(problem(), HasSubstr("store.folder: /proc cannot hold files"));
}

TEST_F(FolderCheck, a_store_that_cannot_be_is_refused_unless_it_is_switched_off) {
    config_.store.folder = root_.path() / "missing" / "store/";
    EXPECT_THAT(problem(), AllOf(HasSubstr("store.folder"), HasSubstr("missing does not exist: create that folder")));
    root_.write("file", "x");
    config_.store.folder = root_.path() / "file";
    EXPECT_THAT(problem(), HasSubstr("file is not a folder"));
    config_.store.folder = root_.path() / "file" / "store";
    EXPECT_THAT(problem(), HasSubstr("store.folder"));
    config_.store.enabled = false;
    EXPECT_EQ(problem(), "none");
}

TEST_F(FolderCheck, a_link_to_nothing_is_no_folder_that_can_be_created) {
    const fs::path link = root_.path() / "link";
    fs::create_symlink("/nonexistent/x", link);
    config_.store.folder = link;
    EXPECT_THAT(problem(),
                HasSubstr("store.folder: " + link.string() + " is a symbolic link to /nonexistent/x, which"));
}

TEST_F(FolderCheck, what_this_user_may_not_do_is_said_with_his_name) {
    config_.store.folder = root_.path() / "locked";
    fs::create_directory(config_.store.folder);
    fs::permissions(config_.store.folder, fs::perms{0555});
    fs::permissions(root_.path(), fs::perms{0755});
    const bool root = ::geteuid() == 0;
    if (root) {
        ASSERT_EQ(::seteuid(65534), 0);
    }
    const std::string existing = problem();
    config_.store.folder /= "store";
    const std::string below = problem();
    if (root) {
        ASSERT_EQ(::seteuid(0), 0);
    }
    EXPECT_THAT(existing, AllOf(HasSubstr("cannot be written by user "), HasSubstr("denied")));
    EXPECT_THAT(below, AllOf(HasSubstr("store.folder"), HasSubstr("cannot be "), HasSubstr("denied")));
}

TEST_F(FolderCheck, all_folders_are_looked_at_and_all_problems_said) {
    const fs::path missing = root_.path() / "missing";
    config_.inspection.recipes = missing;
    config_.state_folder = root_.write("file", "x");
    config_.store.folder = missing / "store";
    const std::string all = problem();
    for (const char* key : {"inspection.recipes", "$STATE_DIRECTORY", "store.folder"}) EXPECT_THAT(all, HasSubstr(key));
}

TEST_F(FolderCheck, the_folder_of_frames_or_scenes_is_looked_at_for_itself) {
    config_.sensor = FrameFolder{root_.path() / "missing"};
    const auto frames = check_sources(config_);
    ASSERT_FALSE(frames);
    EXPECT_THAT(frames.error().message(), AllOf(HasSubstr("sensor.folder"), HasSubstr("does not exist")));
    EXPECT_EQ(problem(), "none") << "it would be said twice";
    config_.sensor = SimulatedSensor{root_.write("file", "x")};
    const auto scenes = check_sources(config_);
    ASSERT_FALSE(scenes);
    EXPECT_THAT(scenes.error().message(), AllOf(HasSubstr("sensor.scenes"), HasSubstr("is not a folder")));
    config_.sensor = SimulatedSensor{root_.path()};
    EXPECT_THAT(check_sources(config_).value_or(std::vector<std::string>()), ElementsAre(HasSubstr("may read it")));
}

TEST_F(FolderCheck, what_is_mounted_later_is_named_without_links) {
    fs::create_directory(root_.path() / "share");
    fs::create_symlink("/nonexistent/disk", root_.path() / "dangling");
    fs::create_symlink("dangling", root_.path() / "second");
    fs::create_symlink("share", root_.path() / "link");
    fs::create_symlink("circle", root_.path() / "circle");
    const auto names = [&](const fs::path& folder, const fs::path& mount) {
        EXPECT_THAT(mounted_late(folder), EndsWith("RequiresMountsFor=" + mount.string()));
    };
    const fs::path root = fs::canonical(root_.path());
    names(root_.path() / "second/frames", "/nonexistent/disk/frames");
    names(root_.path() / "link/../link/frames", root / "share/frames");
    names(root_.path() / "missing", root / "missing");
    names(root_.path() / "circle/frames", root_.path() / "circle/frames");
}

TEST_F(FolderCheck, the_recipes_folder_that_no_key_names_need_not_exist) {
    EXPECT_EQ(problem(), "none");
    root_.write("recipes", "x");
    EXPECT_THAT(problem(), AllOf(HasSubstr("inspection.recipes"), HasSubstr("is not a folder")));
}

}  // namespace
}  // namespace hord::firmware
