// The recipes that a station can switch to: found by number, and what a start tells of those that cannot be selected.
#include "firmware/recipes/recipe_folder.h"

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class RecipeFolder : public ::testing::Test {
  protected:
    void write(const std::string& name, const std::string& text) const { std::ofstream(folder / name) << text; }
    // A pipe with one byte in it: who reads the file takes the byte.
    [[nodiscard]] common::UniqueFd pipe(const std::string& name) const {
        EXPECT_EQ(::mkfifo((folder / name).c_str(), 0600), 0);
        common::UniqueFd fd(::open((folder / name).c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC));
        EXPECT_EQ(::write(fd.get(), "x", 1), 1);
        return fd;
    }
    static bool is_unread(const common::UniqueFd& fd) {
        std::array<char, 2> bytes{};
        return ::read(fd.get(), bytes.data(), bytes.size()) == 1;
    }

    const testing_support::TempFolder temporary;
    const fs::path folder = temporary.path();
};

TEST_F(RecipeFolder, finds_by_number_and_says_why_it_cannot) {
    write("a.toml", "schema = 1\nnumber = 1\n");
    write("b.toml", "schema = 1\nnumber = 2\n");
    write("notes.txt", "number = 3\n");
    EXPECT_TRUE(find_recipe(folder, 2));
    EXPECT_EQ(find_recipe(folder, 3).error().code, ErrorCode::not_found);
    write("c.toml", "schema = 1\nnumber = 1\n");
    EXPECT_EQ(find_recipe(folder, 1).error().code, ErrorCode::refused);
    write("c.toml", "nubmer = 3\n");
    EXPECT_THAT(find_recipe(folder, 3).error().what, HasSubstr("c.toml:1"));
    EXPECT_TRUE(find_recipe(folder, 1));
    EXPECT_EQ(find_recipe(folder / "none", 1).error().code, ErrorCode::not_found);
    write("d.toml", "schema = 1\nnumber = 4\n[reference]\nfile = \"gone.hordref\"\n");
    const auto asked = find_recipe(folder, 4);
    ASSERT_FALSE(asked);
    EXPECT_THAT(asked.error().what,
                ::testing::StartsWith("recipe 4 cannot be used: d.toml:4: reference.file: cannot be used: "
                                      "gone.hordref: cannot be read"));
    EXPECT_THAT(asked.error().cure, HasSubstr("give a file that hordctl learn has written"));
    EXPECT_THAT(asked.error().what, ::testing::Not(HasSubstr("c.toml")));
}

TEST_F(RecipeFolder, finds_a_recipe_without_reading_the_reference_of_another) {
    const auto reference = pipe("two.hordref");
    write("one.toml", "schema = 1\nnumber = 1\n");
    write("two.toml", "schema = 1\nnumber = 2\n[reference]\nfile = \"two.hordref\"\n");
    EXPECT_TRUE(find_recipe(folder, 1));
    EXPECT_TRUE(is_unread(reference));
}

// A station that switches recipes runs: it waits for nobody who writes into a pipe.
TEST_F(RecipeFolder, refuses_a_reference_that_is_a_pipe_without_reading_it) {
    const auto reference = pipe("two.hordref");
    write("two.toml", "schema = 1\nnumber = 2\n[reference]\nfile = \"two.hordref\"\n");
    const auto asked = find_recipe(folder, 2);
    ASSERT_FALSE(asked);
    EXPECT_THAT(asked.error().message(),
                HasSubstr("two.hordref is a pipe, not a regular file: give a file that hordctl"));
    EXPECT_TRUE(is_unread(reference));
}

TEST_F(RecipeFolder, takes_a_link_for_the_recipe_that_it_names_and_refuses_two_contents) {
    const testing_support::TempFolder elsewhere;
    std::ofstream(elsewhere.path() / "other.toml") << "schema = 1\nnumber = 1\n";
    write("a.toml", "schema = 1\nnumber = 1\n");
    fs::create_symlink("a.toml", folder / "b.toml");
    EXPECT_TRUE(find_recipe(folder, 1));
    EXPECT_TRUE(check_recipe_numbers(folder));
    fs::create_symlink(elsewhere.path() / "other.toml", folder / "c.toml");
    EXPECT_FALSE(find_recipe(folder, 1));
    EXPECT_FALSE(check_recipe_numbers(folder)) << "a start tells what a selection refuses";
}

TEST_F(RecipeFolder, tells_of_references_that_are_missing_or_none_and_reads_their_heads_alone) {
    const auto reference = [&](const std::string& name, const std::string& file) {
        write(name, "schema = 1\nnumber = 1\n[reference]\nfile = \"" + file + "\"\n");
    };
    reference("a.toml", "gone.hordref");
    reference("b.toml", "text.hordref");
    write("text.hordref", std::string(200, 'x'));
    reference("c.toml", "pipe.hordref");
    const auto waits = pipe("pipe.hordref");
    write("d.toml", "schema = 1\nnumber = 2\n");
    write("e.toml", "nubmer = \n");
    const std::vector<Error> told = missing_references(folder);
    ASSERT_EQ(told.size(), 3U);
    const std::string here = folder.string() + "/";
    EXPECT_EQ(told[0].message(),
              here + "a.toml: its reference " + here +
                  "gone.hordref: cannot be read (No such file or directory): give a file that "
                  "hordctl learn has written");
    EXPECT_EQ(
        told[1].message(),
        here + "b.toml: its reference " + here + "text.hordref is not a reference: learn it again: hordctl learn");
    EXPECT_THAT(told[2].message(), HasSubstr("pipe.hordref is not a reference"));
    EXPECT_TRUE(is_unread(waits));
    EXPECT_TRUE(missing_references(folder / "none").empty());
}

}  // namespace
}  // namespace hord::firmware
