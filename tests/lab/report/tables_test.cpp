// Tables and plots as files.
#include "lab/report/tables.h"

#include <cstdlib>
#include <fstream>
#include <iterator>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

using test::Folder;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string text_of(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(Tables, csv_quotes_what_would_be_read_as_something_else) {
    const Folder folder;
    ASSERT_TRUE(write_csv(folder.path() / "t.csv", {{"a", "b"}, {{"1", "x, y"}, {"2", "say \"no\""}}}));
    EXPECT_EQ(text_of(folder.path() / "t.csv"), "a,b\n1,\"x, y\"\n2,\"say \"\"no\"\"\"\n");
}

TEST(Tables, markdown_has_a_line_a_row) {
    EXPECT_EQ(to_markdown({{"a", "b"}, {{"1", "2"}}}), "| a | b |\n|---|---|\n| 1 | 2 |\n");
}

TEST(Plots, svg_and_png_are_drawn_from_data_beside_them_whatever_the_folder_is_called) {
    const Folder folder;
    const auto odd = folder.path() / "it's a folder";
    std::filesystem::create_directory(odd);
    ASSERT_TRUE(write_csv(odd / "d.csv", {{"x", "y"}, {{"1", "2"}, {"2", "3"}}}));
    const auto drawn = plot(odd, "p", "set datafile separator ','\nplot 'd.csv' using 1:2 with lines title 'line'");
    ASSERT_TRUE(drawn) << drawn.error().message();
    EXPECT_THAT(text_of(odd / "p.svg"), HasSubstr("<svg"));
    EXPECT_THAT(text_of(odd / "p.png"), StartsWith("\x89PNG"));
}

TEST(Plots, a_script_that_gnuplot_refuses_is_named) {
    const Folder folder;
    const auto drawn = plot(folder.path(), "p", "plot 'no such file.csv' using 1:2");
    ASSERT_FALSE(drawn);
    EXPECT_THAT(drawn.error().message(), HasSubstr("p.gp"));
}

TEST(Plots, without_gnuplot_the_cure_is_said_and_the_script_stays) {
    const Folder folder;
    const std::string path = std::getenv("PATH");
    ASSERT_EQ(setenv("PATH", folder.path().c_str(), 1), 0);
    const auto drawn = plot(folder.path(), "p", "plot sin(x)");
    ASSERT_EQ(setenv("PATH", path.c_str(), 1), 0);
    ASSERT_FALSE(drawn);
    EXPECT_EQ(drawn.error().code, ErrorCode::not_found);
    EXPECT_THAT(drawn.error().message(), HasSubstr("gnuplot-nox"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "p.gp"));
}

}  // namespace
}  // namespace hord::lab
