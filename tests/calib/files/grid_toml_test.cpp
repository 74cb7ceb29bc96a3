// The calibration file: written files are read back, edited files are refused.
#include "calib/files/grid_toml.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using ::testing::HasSubstr;

GridFile example() {
    const auto drawn =
        test::draw({.width_px = 300, .height_px = 260, .hexagonal = true, .pitch_px = 21, .rotation_deg = 3});
    const auto calibration = calibrate_grid(drawn.frame.view());
    return file_of(*calibration, {"ACME \"one\" 0042", "2026-11-21T03:00:00Z", "white.png", ""});
}

TEST(GridToml, what_is_written_is_read_to_the_last_bit) {
    const GridFile file = example();
    const auto read = parse_grid(to_toml(file), "grid.toml");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->grid.parameters, file.grid.parameters);
    EXPECT_EQ(read->sigma, file.sigma);
    EXPECT_EQ(read->grid.stagger, file.grid.stagger);
    EXPECT_EQ(read->grid.parity, file.grid.parity);
    EXPECT_EQ(read->stamp.camera, file.stamp.camera);
    EXPECT_EQ(read->reason, file.reason);
    EXPECT_EQ(read->statistics.found, file.statistics.found);
    for (int n = 0; n < file.grid.rows; ++n) {
        for (int m = 0; m < file.grid.columns; ++m) {
            EXPECT_EQ(read->grid.centre_px(m, n).x_px, file.grid.centre_px(m, n).x_px);
            EXPECT_EQ(read->grid.centre_px(m, n).y_px, file.grid.centre_px(m, n).y_px);
        }
    }
}

TEST(GridToml, shifts_of_single_lenslets_are_written_and_read_to_the_last_bit) {
    GridFile file = example();
    EXPECT_THAT(to_toml(file), HasSubstr("version = 1\n"));
    for (int k = 0; k < file.grid.columns * file.grid.rows; ++k)
        file.grid.shifts_px.push_back({std::round(40 * std::sin(k)) * 0.001, -k * 0.001});
    file.statistics.shifts = {0.03, 0.9, 0.004, 0.005};
    const auto read = parse_grid(to_toml(file), "grid.toml");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_THAT(to_toml(file), HasSubstr("version = 2\n"));
    EXPECT_EQ(to_toml(*read), to_toml(file));
    for (int n = 0; n < file.grid.rows; ++n) {
        for (int m = 0; m < file.grid.columns; ++m) {
            EXPECT_EQ(read->grid.centre_px(m, n).x_px, file.grid.centre_px(m, n).x_px);
            EXPECT_EQ(read->grid.centre_px(m, n).y_px, file.grid.centre_px(m, n).y_px);
        }
    }
    file.grid.shifts_px.pop_back();
    EXPECT_FALSE(parse_grid(to_toml(file), "grid.toml"));
}

TEST(GridToml, models_that_older_programs_do_not_know_raise_the_version) {
    for (const auto& [model, parameters] :
         {std::pair{algo::GridModelKind::similarity_radial1, std::vector<double>{100, 90, 80, 1, -0.03}},
          {algo::GridModelKind::division1, {100, 90, 80, 1, -1, 80, 0.001, 0, -0.06}},
          {algo::GridModelKind::rational2, {100, 90, 80, 1, -1, 80, 0.001, 0, 0.1, 0.2, 0.01, 0}}}) {
        SCOPED_TRACE(name_of(model));
        GridFile file = example();
        file.grid.model = model;
        file.grid.parameters = parameters;
        file.grid.shifts_px.clear();
        EXPECT_THAT(to_toml(file), HasSubstr("version = 3\n"));
        const auto read = parse_grid(to_toml(file), "grid.toml");
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(read->grid.model, model);
        EXPECT_EQ(read->grid.centre_px(3, 2).x_px, file.grid.centre_px(3, 2).x_px);
    }
}

TEST(GridToml, one_changed_digit_is_refused) {
    std::string text = to_toml(example());
    const auto at = text.find("columns = ") + 10;
    text[at] = text[at] == '9' ? '8' : '9';
    const auto read = parse_grid(text, "grid.toml");
    ASSERT_FALSE(read);
    EXPECT_THAT(read.error().message(), HasSubstr("checksum"));
}

TEST(GridToml, another_kind_of_file_is_refused_with_its_name) {
    const auto read = parse_grid("[light]\nradius = 1\n", "light.toml");
    ASSERT_FALSE(read);
    EXPECT_THAT(read.error().message(), HasSubstr("light.toml"));
    EXPECT_FALSE(read_grid("/nonexistent/grid.toml"));
    EXPECT_FALSE(write_grid("/nonexistent/grid.toml", example()));
}

TEST(GridToml, files_and_centres_are_written_whole) {
    const auto folder = std::filesystem::path(::testing::TempDir());
    const GridFile file = example();
    ASSERT_TRUE(write_grid(folder / "grid.toml", file));
    const auto read = read_grid(folder / "grid.toml");
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->grid.parameters, file.grid.parameters);

    const auto drawn = test::draw({.width_px = 200, .height_px = 200, .pitch_px = 20, .rotation_deg = 2});
    const auto calibration = calibrate_grid(drawn.frame.view());
    ASSERT_TRUE(calibration) << calibration.error().message();
    ASSERT_TRUE(write_centres(folder / "centres.csv", *calibration));
    std::ifstream in(folder / "centres.csv");
    std::string line;
    std::getline(in, line);
    EXPECT_EQ(line, "m,n,x_px,y_px");
    std::size_t lines = 0;
    while (std::getline(in, line)) ++lines;
    EXPECT_EQ(lines, drawn.truth.size());
}

}  // namespace
}  // namespace hord::calib
