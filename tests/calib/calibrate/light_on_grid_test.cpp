// The share of a white frame's bright pixels that lie in the cells of its lenslets, against a count pixel by pixel.
#include "calib/calibrate/light_on_grid.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using test::White;

constexpr std::uint32_t kHalfDn = 10'000;  // no pixel of the frames below is near it

// Light without a soft edge: every pixel is dark or bright.
White sharp() {
    White white;
    white.pitch_px = 14.3;
    white.edge_px = 1e-6;
    white.noise = false;
    return white;
}

// As check_white_frame() has it, from the definition: a pixel is on the grid within half a diagonal of a centre.
double counted(const Frame& frame, const GridCalibration& calibration) {
    const double pitch = calibration.lattice.pitch_px(), reach2 = pitch * pitch / 2;
    const int border = static_cast<int>(std::ceil(1.5 * pitch));
    int all = 0, on_grid = 0;
    for (int y = border; y < frame.height_px() - border; ++y) {
        for (int x = border; x < frame.width_px() - border; ++x) {
            if (frame.view().sample(x, y) < kHalfDn) continue;
            ++all;
            for (const Observation& seen : calibration.observations) {
                const double dx = x - seen.centre_px.x_px, dy = y - seen.centre_px.y_px;
                if (dx * dx + dy * dy > reach2) continue;
                ++on_grid;
                break;
            }
        }
    }
    return static_cast<double>(on_grid) / all;
}

void expect_as_counted(const Frame& frame, const GridCalibration& calibration) {
    const auto image = WhiteImage::open(frame.view(), {});
    ASSERT_TRUE(image);
    EXPECT_EQ(light_on_grid(*image, calibration).share, counted(frame, calibration));
}

// The corners of lenslets at 45 degrees lie in the cells, but not in the upright squares within these. Pixels that are
// dark or bright move the centres of such lenslets by 0.2 px: 1.5 % of a pitch of 14.3 px, which is refused.
TEST(LightOnGrid, is_that_of_the_cells_for_lenslets_with_corners_beside_the_squares) {
    White white = sharp();
    white.square = true;
    white.pitch_px = 24.3;
    white.rotation_deg = 45;
    const Frame frame = test::draw(white).frame;
    const auto calibration = calibrate_grid(frame.view());
    ASSERT_TRUE(calibration) << calibration.error().what;
    EXPECT_EQ(counted(frame, *calibration), 1);
    expect_as_counted(frame, *calibration);
}

// A bright bar in a row and a column of dead lenslets: a part of it lies in no cell.
TEST(LightOnGrid, is_less_where_light_lies_beside_all_cells) {
    White white = sharp();
    white.hexagonal = true;
    white.rotation_deg = 7.3;
    white.dead_share = 0.1;
    Frame frame = test::draw(white).frame;
    const auto calibration = calibrate_grid(frame.view());
    ASSERT_TRUE(calibration) << calibration.error().what;
    for (int k = 40; k < 360; ++k) {
        for (int across = 195; across < 205; ++across) {
            frame.set(k, across, 20'000);
            frame.set(across, k, 20'000);
        }
    }
    EXPECT_LT(counted(frame, *calibration), 1);
    expect_as_counted(frame, *calibration);
}

}  // namespace
}  // namespace hord::calib
