// Photographs of real lenslet arrays: each is refused, or measured as accurately as before.
#include <cstdlib>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {
namespace {

std::filesystem::path data() {
    if (const char* given = std::getenv("HORD_DATA")) return given;
    return std::filesystem::path(HORD_SOURCE_DIR) / ".." / "shared" / "data";
}

struct Picture {
    cv::Mat pixels;
    [[nodiscard]] FrameView view() const {
        return {reinterpret_cast<const std::byte*>(pixels.data), pixels.cols, pixels.rows,
                static_cast<std::ptrdiff_t>(pixels.step[0]), pixels.depth() == CV_8U ? 8 : 16};
    }
};

class RealFrames : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!std::filesystem::exists(data() / "lenslet"))
            GTEST_SKIP() << "no real frames: set HORD_DATA to the folder that holds lenslet/";
    }
    static Picture load(const std::string& name) {
        return {cv::imread((data() / "lenslet" / (name + ".png")).string(), cv::IMREAD_UNCHANGED)};
    }

    // `cv_px`: limit of the RMS cross-validated over blocks, per axis. At least `found` lenslets must be found, and 99
    // % of the fully lit ones.
    static void expect(const std::string& name, algo::LatticeKind kind, double pitch, double cv_px, int found) {
        SCOPED_TRACE(name);
        const auto calibration = calibrate_grid(load(name).view());
        ASSERT_TRUE(calibration) << calibration.error().message();
        EXPECT_EQ(calibration->fit.grid.kind, kind);
        EXPECT_NEAR(calibration->pitch_px, pitch, 0.01 * pitch);
        EXPECT_LE(calibration->fit.cv_x_rms_px, cv_px);
        EXPECT_LE(calibration->fit.cv_y_rms_px, cv_px);
        EXPECT_GE(calibration->found, found);
        EXPECT_GE(calibration->whole_found, 0.99 * calibration->whole);
        EXPECT_LE(calibration->whole, calibration->complete);
    }
};

using enum algo::LatticeKind;

TEST_F(RealFrames, light_field_microscope) { expect("lf_sq_napariLF_white", square, 15.4, 0.0145, 776); }
TEST_F(RealFrames, binospec) { expect("sh_sq_mmt_binospec_ref", square, 22.95, 0.009, 463); }
TEST_F(RealFrames, f5_hecto) { expect("sh_sq_mmt_f5hecto_ref", square, 29.75, 0.053, 268); }
TEST_F(RealFrames, f9_is_hexagonal) { expect("sh_hex_mmt_f9_ref", hexagonal, 31.5, 0.15, 165); }
TEST_F(RealFrames, led) { expect("sh_sq_mmt_LED", square, 20.0, 0.15, 595); }
TEST_F(RealFrames, mmirs) { expect("sh_sq_mmt_mmirs1_ref", square, 20.9, 0.15, 215); }
TEST_F(RealFrames, yuuto_dusty_and_dim) { expect("sh_sq_yuuto", square, 25.6, 0.1, 2650); }

TEST_F(RealFrames, the_dark_frame_changes_little) {
    const Picture white = load("lf_sq_napariLF_white");
    const Picture dark = load("lf_sq_napariLF_dark");
    const auto with = calibrate_grid(white.view(), dark.view());
    const auto without = calibrate_grid(white.view());
    ASSERT_TRUE(with && without);
    EXPECT_NEAR(with->pitch_px, without->pitch_px, 0.001);
    EXPECT_LE(with->fit.cv_x_rms_px, 0.014);
}

TEST_F(RealFrames, bad_frames_are_refused_with_the_reason) {
    for (const char* name :
         {"sh_bad_mmt_mmirs_blank", "sh_bad_mmt_mmirs_bogus", "lf_sq_napariLF_dark", "lf_sq_napariLF_object"}) {
        SCOPED_TRACE(name);
        const auto calibration = calibrate_grid(load(name).view());
        ASSERT_FALSE(calibration);
        EXPECT_EQ(calibration.error().code, ErrorCode::refused);
        EXPECT_FALSE(calibration.error().what.empty());
        EXPECT_FALSE(calibration.error().cure.empty());
    }
}

}  // namespace
}  // namespace hord::calib
