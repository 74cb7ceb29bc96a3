// The calibration of a running station: it must fit the sensor, has a checksum, and a worse one does not replace a
// better one; and the drift monitor.
#include "firmware/devices/active_calibration.h"

#include <cmath>
#include <ctime>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/monitoring/drift_monitor.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;

class CalibrationFile : public ::testing::Test {
  protected:
    CalibrationFile()
        : folder(std::filesystem::temp_directory_path() / ("hord-calibration-" + std::to_string(::getpid()))) {
        std::filesystem::create_directories(folder);
    }
    ~CalibrationFile() override { std::filesystem::remove_all(folder); }

    // Writes a calibration of a 320 x 288 px sensor; `cv_px`: RMS of its cross-validation residuals, in px.
    [[nodiscard]] std::filesystem::path write(const char* name, double cv_px, const char* camera = "one") const {
        calib::GridFile file;
        file.grid.columns = 20;
        file.grid.rows = 18;
        file.grid.width_px = 320;
        file.grid.height_px = 288;
        file.grid.parameters = {7.5, 7.5, 16, 0};
        file.stamp = {camera, "2026-01-31T12:00:00Z", "white.png", ""};
        file.statistics.complete = file.statistics.found = 360;
        file.statistics.blocks = 25;
        file.statistics.cv_x_rms_px = file.statistics.cv_y_rms_px = cv_px;
        EXPECT_TRUE(calib::write_grid(folder / name, file));
        return folder / name;
    }
    [[nodiscard]] Result<ActiveCalibration> use(const std::filesystem::path& file) const {
        const auto kept = kept_calibration(folder);
        auto read = read_calibration(file, 8, 8);
        if (!read) return read;
        if (auto fits = check_calibration(*read, kept, {320, 288, 8, 4}); !fits) return tl::unexpected(fits.error());
        EXPECT_TRUE(calib::write_grid(kept, read->file));
        return read;
    }

    std::filesystem::path folder;
};

TEST_F(CalibrationFile, is_read_and_known_by_its_checksum) {
    const auto one = use(write("one.toml", 0.01));
    ASSERT_TRUE(one) << one.error().message();
    EXPECT_EQ(one->decoder->extents(), (algo::Extents{20, 18, 8, 8}));
    EXPECT_NE(one->crc32, 0U);
    EXPECT_EQ(use(write("same.toml", 0.01))->crc32, one->crc32);
    EXPECT_NE(use(write("other.toml", 0.0099))->crc32, one->crc32);
    ASSERT_TRUE(one->age_s());
    EXPECT_NEAR(static_cast<double>(*one->age_s()), static_cast<double>(std::time(nullptr)) - 1769860800.0, 5.0);
}

TEST_F(CalibrationFile, that_does_not_fit_the_sensor_is_refused_with_both_sizes) {
    const auto file = write("one.toml", 0.01);
    const auto refused = check_calibration(*read_calibration(file, 8, 8), {}, {436, 436, 8, 4});
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message(), HasSubstr("one.toml"));
    EXPECT_THAT(refused.error().message(), HasSubstr("320x288"));
    EXPECT_THAT(refused.error().message(), HasSubstr("436x436"));
    EXPECT_FALSE(read_calibration(file, 8, 40));
    EXPECT_FALSE(use(folder / "none.toml"));
}

// Frames of two cameras may have one size: each lenslet would be decoded beside its place.
TEST_F(CalibrationFile, of_another_camera_than_the_one_in_use_is_told) {
    const auto kept = kept_calibration(folder);
    const auto one = read_calibration(write("one.toml", 0.01), 8, 8);
    ASSERT_TRUE(one);
    EXPECT_FALSE(other_camera(*one, kept)) << "none was in use";
    ASSERT_TRUE(use(folder / "one.toml"));
    EXPECT_FALSE(other_camera(*one, kept));
    const auto two = read_calibration(write("two.toml", 0.01, "two"), 8, 8);
    ASSERT_TRUE(two);
    const auto told = other_camera(*two, kept);
    ASSERT_TRUE(told);
    EXPECT_THAT(told->message(),
                HasSubstr("two.toml is a calibration of camera \"two\", the one in use before of \"one\""));
    std::ofstream(kept) << "damaged";
    EXPECT_FALSE(other_camera(*two, kept));
}

TEST_F(CalibrationFile, that_is_worse_does_not_take_the_place_of_the_one_in_use) {
    ASSERT_TRUE(use(write("good.toml", 0.01)));
    const auto worse = write("worse.toml", 0.03);
    for (int start = 0; start < 2; ++start) {
        const auto refused = use(worse);
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::refused);
        EXPECT_THAT(refused.error().message(), HasSubstr("worse.toml"));
        EXPECT_THAT(refused.error().message(),
                    HasSubstr("calibration-in-use.toml"));  // the message names the file to remove
    }
    EXPECT_TRUE(use(write("good.toml", 0.01)));
    EXPECT_TRUE(use(write("better.toml", 0.005)));
    EXPECT_FALSE(use(write("good.toml", 0.01)));  // now it is the worse one
    // A worse calibration is accepted once kept.toml is removed, and when it is of another camera.
    std::filesystem::remove(folder / "calibration-in-use.toml");
    EXPECT_TRUE(use(worse));
    EXPECT_TRUE(use(write("theirs.toml", 0.1, "another")));
}

TEST_F(CalibrationFile, kept_by_a_station_that_can_no_longer_be_read_stands_in_nobodys_way) {
    std::ofstream(folder / "calibration-in-use.toml") << "what is this\n";
    EXPECT_TRUE(use(write("one.toml", 0.01)));
    EXPECT_TRUE(calib::read_grid(folder / "calibration-in-use.toml"));
}

// -- drift

// Light without a part, `x_bins` (0 to 1) right of the middle bin.
Frame free_light(const algo::Extents& e, double x_bins) {
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            frame.set(m * e.i + e.i / 2, n * e.j + e.j / 2,
                      static_cast<std::uint32_t>(std::lround(200 * (1 - x_bins))));
            frame.set(m * e.i + e.i / 2 + 1, n * e.j + e.j / 2, static_cast<std::uint32_t>(std::lround(200 * x_bins)));
        }
    }
    return frame;
}

TEST(DriftMonitor, notices_a_tenth_of_a_pixel_within_fifty_parts_and_when_it_is_over) {
    const algo::Extents extents{30, 30, 5, 5};
    auto watch = DriftMonitor::create(extents, {0, 16, 255}, algo::DriftZero::calibration, 2);  // a bin is two pixels
    ASSERT_TRUE(watch);
    const auto parts_until_changed = [&](double x_bins) {
        const Frame frame = free_light(extents, x_bins);
        for (int k = 1; k <= 100; ++k) {
            if ((*watch)->add(frame.view(), 0)) return k;
        }
        return 0;
    };
    for (int k = 0; k < 40; ++k) EXPECT_FALSE((*watch)->add(free_light(extents, 0).view(), 0));
    EXPECT_FALSE((*watch)->view().noticed);
    const int noticed = parts_until_changed(0.05);
    EXPECT_GT(noticed, 0);
    EXPECT_LE(noticed, 50);
    EXPECT_TRUE((*watch)->view().noticed);
    EXPECT_TRUE((*watch)->view().since_calibration);
    EXPECT_NEAR(*(*watch)->view().largest_px, 0.1, 0.01);
    EXPECT_EQ(parts_until_changed(0.035), 0);  // 0.07 px: the state does not change
    EXPECT_GT(parts_until_changed(0.02), 0);
    EXPECT_FALSE((*watch)->view().noticed);
    EXPECT_EQ(parts_until_changed(0.035), 0);
}

}  // namespace
}  // namespace hord::firmware
