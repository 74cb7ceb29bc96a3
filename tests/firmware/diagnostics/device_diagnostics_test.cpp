// The check of a cell's devices, on the simulated cell in virtual time with frames drawn by the test.
#include "firmware/diagnostics/device_diagnostics.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/diagnostics/frame_quality.h"
#include "hal_sim/cell/cell.h"
#include "lab/virtual_time/virtual_time.h"

namespace hord::firmware {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

constexpr int kLenslets = 9, kBins = 9;

// One spot a lenslet, of a given radius and brightness. Without the strobe the frame shows only the leaking light.
class DrawnSpots final : public sim::FrameSource {
  public:
    double radius_bins = 0.7, brightest = 0.7, leak = 0;
    [[nodiscard]] Format format() const override { return {kLenslets * kBins, kLenslets * kBins, 8}; }
    FrameView expose(const sim::Exposure& exposure, std::span<std::byte> scratch) override {
        const int width = format().width_px;
        for (int y = 0; y < width; ++y) {
            for (int x = 0; x < width; ++x) {
                const int dx = x % kBins - (kBins - 1) / 2, dy = y % kBins - (kBins - 1) / 2;
                const double spot = std::exp(-(dx * dx + dy * dy) / (2 * radius_bins * radius_bins));
                const double level = std::min(1.0, brightest * spot * exposure.light + leak);
                scratch[static_cast<std::size_t>(y * width + x)] = static_cast<std::byte>(std::lround(255 * level));
            }
        }
        return {scratch.data(), width, width, width, 8};
    }
};

class DeviceDiagnosticsTest : public testing::Test {
  protected:
    // Opens the cell with the frames as they are now.
    void open(std::vector<sim::InjectionRule> faults = {}) {
        sim::CellOptions options;
        options.faults = std::move(faults);
        options.strobe.limits = {2ms, 1ms, 2};
        options.schedule.first_mm = 1e6;  // the belt moves, no part comes
        options.strobe.nominal_pulse = under_test_.core.strobe;
        auto made = sim::SimulatedCell::make(loop_, frames_, options);
        ASSERT_TRUE(made) << made.error().message();
        cell_ = std::move(*made);
        sim::World::Watchers watchers;
        watchers.ejector = [this](bool opens, hal::TimePoint) { pulses_ += opens ? 1 : 0; };
        cell_->watch(std::move(watchers));
        cell_->start();
        under_test_.part_sensor = {&cell_->part_sensor(), "simulated"};
        under_test_.strobe = {&cell_->strobe(), "simulated"};
        under_test_.sensor = {&cell_->sensor(), "simulated"};
        under_test_.rejector = {&cell_->rejector(), "simulated"};
        under_test_.ask_module = [] { return std::string("a module"); };
    }
    std::vector<CheckRow> check(bool actuate = false) {
        DeviceDiagnosticsOptions options;
        options.actuate = actuate;
        options.wait = [&](const std::function<bool()>& done, hal::Duration patience) {
            const hal::TimePoint end = loop_.now() + patience;
            if (loop_.run_until(done, end)) return true;
            loop_.run_until(end);
            return false;
        };
        return check_cell(loop_, under_test_, options);
    }
    static CheckRow row(const std::vector<CheckRow>& rows, const std::string& what) {
        for (const CheckRow& one : rows) {
            if (one.what == what) return one;
        }
        return {what, CheckRow::Result::skipped, "there is no such row", {}};
    }
    static int bad(const std::vector<CheckRow>& rows) {
        int count = 0;
        for (const CheckRow& one : rows) {
            if (one.result != CheckRow::Result::bad) continue;
            ++count;
            EXPECT_FALSE(one.cure.empty()) << one.what;
        }
        return count;
    }

    lab::VirtualTime loop_;
    DrawnSpots frames_;
    std::unique_ptr<sim::SimulatedCell> cell_;
    CellUnderTest under_test_;
    int pulses_ = 0;
};

TEST_F(DeviceDiagnosticsTest, a_good_cell_has_good_rows_and_its_ejector_rests) {
    open();
    const auto rows = check();
    EXPECT_EQ(bad(rows), 0) << table_of(rows);
    for (const char* what : {"part sensor", "lights", "light 0", "light 1", "sensor", "frame", "exposure", "saturation",
                             "focus", "without light", "rejector"}) {
        EXPECT_EQ(row(rows, what).result, CheckRow::Result::good) << what << "\n" << table_of(rows);
    }
    EXPECT_EQ(row(rows, "ejector").result, CheckRow::Result::skipped);
    EXPECT_EQ(pulses_, 0);
}

TEST_F(DeviceDiagnosticsTest, the_ejector_is_pulsed_once_when_asked_to) {
    open();
    const auto rows = check(true);
    EXPECT_EQ(row(rows, "ejector").result, CheckRow::Result::good) << table_of(rows);
    EXPECT_EQ(pulses_, 1);
}

TEST_F(DeviceDiagnosticsTest, what_could_not_be_opened_is_a_row_with_its_cure_and_the_rest_is_tested) {
    open();
    under_test_.part_sensor.device = fail(ErrorCode::busy, "chip line 6 is held by \"gpiomon\"", "end that program");
    under_test_.sensor.device = fail(ErrorCode::not_found, "/dev/video0: cannot be opened", "check the cable");
    under_test_.ask_module = []() -> Result<std::string> {
        return fail(ErrorCode::refused, "coil 0 cannot be read: Illegal data address", "check the address");
    };
    const auto rows = check(true);
    EXPECT_EQ(bad(rows), 3) << table_of(rows);
    const std::string table = table_of(rows);
    EXPECT_THAT(table, HasSubstr("held by \"gpiomon\""));
    EXPECT_THAT(table, HasSubstr("cure: end that program"));
    EXPECT_THAT(table, HasSubstr("/dev/video0"));
    EXPECT_THAT(table, HasSubstr("Illegal data address"));
    EXPECT_EQ(row(rows, "light 1").result, CheckRow::Result::good);
    EXPECT_EQ(pulses_, 0) << "a module that refuses is not moved";
}

TEST_F(DeviceDiagnosticsTest, devices_that_are_simulated_are_said_not_to_be_tested) {
    open();
    under_test_.sensor.device = nullptr;
    under_test_.strobe.device = nullptr;
    const auto rows = check();
    EXPECT_EQ(row(rows, "sensor").result, CheckRow::Result::skipped);
    EXPECT_EQ(row(rows, "lights").result, CheckRow::Result::skipped);
    EXPECT_EQ(bad(rows), 0);
}

TEST_F(DeviceDiagnosticsTest, light_that_does_not_come_is_told) {
    open({{.fault = sim::InjectedFault::strobe_refused}});
    EXPECT_EQ(row(check(), "light 0").result, CheckRow::Result::bad);
    open({{.fault = sim::InjectedFault::strobe_dead}});  // the strobe reports light but emits none
    const auto rows = check();
    EXPECT_EQ(row(rows, "light 0").result, CheckRow::Result::good);
    EXPECT_EQ(row(rows, "exposure").result, CheckRow::Result::bad);
    EXPECT_EQ(row(rows, "focus").result, CheckRow::Result::bad);
}

TEST_F(DeviceDiagnosticsTest, frames_that_do_not_come_or_are_damaged_are_told) {
    open({{.fault = sim::InjectedFault::frame_drop}});
    EXPECT_THAT(row(check(), "frame").found, HasSubstr("none within"));
    open({{.fault = sim::InjectedFault::frame_short}});
    EXPECT_THAT(row(check(), "frame").found, HasSubstr("damaged"));
    open({{.fault = sim::InjectedFault::sensor_lost}});
    EXPECT_EQ(row(check(), "frame").result, CheckRow::Result::bad);
    frames_ = {};
    under_test_.bins_i = 10;
    open();
    EXPECT_EQ(row(check(), "exposure").result, CheckRow::Result::bad) << "no macro-pixels of 10 bins";
}

TEST_F(DeviceDiagnosticsTest, exposure_saturation_focus_and_stray_light_are_judged_apart) {
    const auto rows_with = [&](double radius, double brightest, double leak) {
        frames_.radius_bins = radius;
        frames_.brightest = brightest;
        frames_.leak = leak;
        open();
        return check();
    };
    auto rows = rows_with(0.7, 0.1, 0);
    EXPECT_EQ(row(rows, "exposure").result, CheckRow::Result::bad);
    EXPECT_EQ(row(rows, "focus").result, CheckRow::Result::good);
    rows = rows_with(0.7, 2, 0);
    EXPECT_EQ(row(rows, "exposure").result, CheckRow::Result::bad);
    EXPECT_EQ(row(rows, "saturation").result, CheckRow::Result::bad);
    rows = rows_with(3, 0.7, 0);
    EXPECT_EQ(bad(rows), 1);
    EXPECT_EQ(row(rows, "focus").result, CheckRow::Result::bad);
    rows = rows_with(0.7, 0.7, 0.016);  // one DN above the dark level everywhere: an eighth of the light
    EXPECT_EQ(bad(rows), 1);
    EXPECT_EQ(row(rows, "without light").result, CheckRow::Result::bad);
}

TEST_F(DeviceDiagnosticsTest, a_rejector_that_does_not_act_is_told) {
    open({{.fault = sim::InjectedFault::reject_lost}});
    EXPECT_EQ(row(check(true), "ejector").result, CheckRow::Result::bad);
    open({{.fault = sim::InjectedFault::rejector_down, .amount = 3600s}});
    EXPECT_EQ(row(check(true), "ejector").result, CheckRow::Result::bad);
}

// The spot above the frame's own dark level, as it is judged; the mean above the recipe's, or stray light would not
// show.
TEST(FrameQuality, of_a_spot_on_a_pedestal_is_that_of_the_spot_and_the_pedestal_shows_in_the_mean) {
    const algo::Extents extents{8, 8, 9, 9};
    Frame frame(72, 72, 8);
    for (int y = 0; y < 72; ++y) {
        for (int x = 0; x < 72; ++x) frame.set(x, y, x % 9 == 4 && y % 9 == 4 ? 204 : 7);
    }
    const auto quality = quality_of(frame.view(), extents, {});
    ASSERT_TRUE(quality);
    EXPECT_DOUBLE_EQ(quality->spot_bins, 0);
    EXPECT_DOUBLE_EQ(quality->mean, (204.0 - 3 + 80 * (7 - 3)) / 255 / 81);
}

TEST(FrameQuality, of_a_single_lit_bin_and_of_evenly_lit_bins_is_known) {
    const algo::Extents extents{3, 3, 9, 9};
    Frame one(27, 27, 8), even(27, 27, 8);
    for (int y = 0; y < 27; ++y) {
        for (int x = 0; x < 27; ++x) {
            one.set(x, y, x % 9 == 4 && y % 9 == 4 ? 204 : 0);
            even.set(x, y, 51);
        }
    }
    const auto point = quality_of(one.view(), extents, {});
    ASSERT_TRUE(point);
    EXPECT_DOUBLE_EQ(point->spot_bins, 0);
    EXPECT_DOUBLE_EQ(point->bright, 0.8);
    EXPECT_DOUBLE_EQ(point->mean, (204.0 - 3) / 255 / 81);  // minus the recipe's dark level
    EXPECT_DOUBLE_EQ(point->lit, 1);
    const auto flat = quality_of(even.view(), extents, {});
    ASSERT_TRUE(flat);
    EXPECT_NEAR(flat->spot_bins, std::sqrt(80 / 12.0), 1e-12);
    EXPECT_NEAR(flat->spot_bins, flat->unfocused_bins, 1e-12);
    EXPECT_FALSE(judge_focus(*flat).good);
}

}  // namespace
}  // namespace hord::firmware
