// OpticsMonitor: when a fault begins and ends, and what messages, journal and registers show.
#include "firmware/monitoring/optics_monitor.h"

#include <cmath>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/plc/register_server_model.h"
#include "firmware/service/journal.h"

namespace hord::firmware {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr algo::Extents kField{40, 32, 5, 5};

// Identical parts without noise; the test changes single properties.
class Line {
  public:
    explicit Line(const OpticsConfig& limits = {.window_parts = 25,
                                                .least_light = 0.8,
                                                .most_dark_drift_dn = 1,
                                                .most_uneven = 0.2})
        : watch(std::move(*OpticsMonitor::create(kField, limits))), shares_(kField.lenslets(), 1.0F),
          mask_(kField.lenslets(), algo::kValid), frame_(kField.width_px(), kField.height_px(), 8) {}

    // Feeds `count` windows of 25 parts. Returns true if add() returned true for any part.
    bool windows(int count) {
        bool news = false;
        for (int y = 0; y < frame_.height_px(); ++y) {
            for (int x = 0; x < frame_.width_px(); ++x)
                frame_.set(x, y, static_cast<std::uint32_t>(x % 5 == 2 && y % 5 == 2 ? 200 : dark));
        }
        algo::Inspection part;
        part.verdict = algo::Verdict::pass;
        std::vector<std::uint32_t> sums;
        for (const float share : shares_)
            sums.push_back(static_cast<std::uint32_t>(std::lround(1e6 * light * static_cast<double>(share))));
        part.sums = sums;
        part.mask = mask_;
        for (int k = 0; k < 25 * count; ++k) news = watch->add(frame_.view(), part) || news;
        return news;
    }
    void speck(int m, int n, float transmission) { shares_[static_cast<std::size_t>(n * kField.m + m)] = transmission; }
    // Sets the transmission of the upper left lenslets: an eighth of the field in m and in n.
    void tile(float transmission) {
        for (int n = 0; n < kField.n / 8; ++n) {
            for (int m = 0; m < kField.m / 8; ++m) speck(m, n, transmission);
        }
    }
    std::uint32_t faults() const { return watch->view().faults; }

    double light = 1;
    int dark = 2;
    std::unique_ptr<OpticsMonitor> watch;

  private:
    std::vector<float> shares_;  // transmission of each lenslet
    std::vector<std::uint8_t> mask_;
    Frame frame_;
};

TEST(OpticsMonitor, a_fading_light_is_a_fault_below_its_share_and_over_a_quarter_of_the_way_back) {
    Line line;
    line.windows(1);
    EXPECT_EQ(line.faults(), 0U);
    line.light = 0.81;
    EXPECT_FALSE(line.windows(40));
    line.light = 0.78;
    EXPECT_TRUE(line.windows(40));
    EXPECT_EQ(line.faults(), kFaultLightFading);
    EXPECT_EQ(line.watch->news(), kFaultLightFading);
    EXPECT_EQ(line.watch->news(), 0U) << "once";
    const Error told = describe(kFaultLightFading, line.watch->view());
    EXPECT_THAT(told.what, HasSubstr("78 % of the light that the first parts had"));
    EXPECT_THAT(told.cure, HasSubstr("replace the LED"));
    line.light = 0.82;
    EXPECT_FALSE(line.windows(40));
    line.light = 0.86;
    EXPECT_TRUE(line.windows(40));
    EXPECT_EQ(line.faults(), 0U);
    EXPECT_EQ(line.watch->news(), 0U) << "nothing came";
}

TEST(OpticsMonitor, the_dark_level_may_neither_rise_nor_fall) {
    Line line;
    line.windows(1);
    line.dark = 4;
    EXPECT_TRUE(line.windows(1));
    EXPECT_EQ(line.faults(), kFaultDarkDrift);
    EXPECT_THAT(describe(kFaultDarkDrift, line.watch->view()).what,
                HasSubstr("by +2.00 DN since the first parts, to 4.00 DN"));
    line.dark = 2;
    EXPECT_TRUE(line.windows(1));
    line.dark = 0;
    EXPECT_TRUE(line.windows(1));
    EXPECT_EQ(line.faults(), kFaultDarkDrift);
}

TEST(OpticsMonitor, a_region_that_darkens_is_told_with_its_place) {
    Line line;
    line.windows(1);
    line.tile(0.7F);
    EXPECT_TRUE(line.windows(30));
    EXPECT_EQ(line.faults() & kFaultLightUneven, kFaultLightUneven);
    EXPECT_THAT(describe(kFaultLightUneven, line.watch->view()).what,
                HasSubstr("around lenslet (2, 2) has changed by -30 %"));
}

TEST(OpticsMonitor, dust_is_told_with_lenslet_and_mm_and_again_when_it_lies_elsewhere) {
    Line line;
    line.watch->restart(0.2F);
    line.windows(1);
    EXPECT_EQ(line.faults(), 0U);
    line.speck(30, 10, 0.5F);
    EXPECT_TRUE(line.windows(1));
    EXPECT_EQ(line.faults(), kFaultDust);
    EXPECT_EQ(line.watch->news(), kFaultDust);
    const Error told = describe(kFaultDust, line.watch->view());
    EXPECT_THAT(told.what,
                HasSubstr("in 100 % of the last 25 parts: lenslet (30, 10), at (2.10, -1.10) mm from the field's "
                          "middle, 1 lenslet;"));
    EXPECT_THAT(told.what, HasSubstr("dust on the optics, or the same flaw in every part; a warm pixel of the sensor"));
    EXPECT_THAT(told.cure, HasSubstr("clean the lenslet array"));
    EXPECT_FALSE(line.windows(3)) << "told once";
    line.speck(30, 10, 1);
    line.speck(12, 20, 0.5F);
    EXPECT_TRUE(line.windows(1));
    EXPECT_EQ(line.watch->news(), kFaultDust);
    line.speck(12, 20, 1);
    EXPECT_TRUE(line.windows(1));
    EXPECT_EQ(line.faults(), 0U);
    EXPECT_THAT(describe(kFaultDust, line.watch->view()).what, HasSubstr("no dust"));
}

TEST(OpticsMonitor, another_recipe_begins_anew) {
    Line line;
    line.windows(1);
    line.light = 0.5;
    line.speck(30, 10, 0.5F);
    line.windows(20);
    EXPECT_EQ(line.faults(), kFaultLightFading | kFaultDust);
    line.watch->restart(0);
    EXPECT_EQ(line.faults(), 0U);
    EXPECT_FALSE(line.watch->view().light);
    line.speck(30, 10, 1);
    EXPECT_FALSE(line.windows(4)) << "half the light is what these parts have";
    EXPECT_THAT(describe(kFaultDust, line.watch->view()).what, Not(HasSubstr("mm")));
}

TEST(OpticsMonitor, the_journal_tells_each_fault_with_an_id_of_its_own_and_its_end) {
    std::vector<std::pair<std::string, std::string>> told;
    StationJournal story([&](const Entry& entry, std::string_view message, std::span<const Field>) {
        told.emplace_back(entry.id, message);
    });
    story.faults(kFaultDust | kFaultLightFading);
    story.faults(0);
    ASSERT_EQ(told.size(), 4U);
    EXPECT_EQ(told[0].first, "83e066eefde0496b8ce4dac31331004f");
    EXPECT_THAT(told[0].second, HasSubstr("fault light-fading: "));
    EXPECT_EQ(told[1].first, "e0c6a143346e499d83a9464aeaa60f19");
    EXPECT_THAT(told[1].second, HasSubstr("clean the lenslet array"));
    EXPECT_THAT(told[3].second, HasSubstr("fault dust is over"));
}

TEST(StationJournal, tells_a_fault_when_it_is_raised_and_why_the_line_is_stopped) {
    std::vector<std::string> told;
    StationJournal story(
        [&](const Entry&, std::string_view message, std::span<const Field>) { told.emplace_back(message); });
    const std::uint32_t opening = kFaultSensor | kFaultRejector;
    story.state(State::preoperational, State::initialized, opening);
    EXPECT_THAT(told, testing::ElementsAre("Preoperational to Initialized")) << "devices that are just opening";
    story.raised(kFaultRejectUnconfirmed, {LineStopCause::place_lost, 12});
    story.state(State::continuous_execution, State::halted, kFaultRejectUnconfirmed);
    story.state(State::halted, State::preoperational, 0);
    ASSERT_EQ(told.size(), 5U);
    EXPECT_THAT(told[1],
                HasSubstr("the line is stopped (the line had no run permit while part 12 came or was on its way: its "
                          "place is not known): take the parts"));
    EXPECT_EQ(told[2], "ContinuousExecution to Halted");
    EXPECT_EQ(told[3], "fault reject-unconfirmed is over");
    story.state(State::ready, State::error, kFaultSensor);
    EXPECT_THAT(told[5], HasSubstr("fault sensor: "));
    EXPECT_EQ(told[6], "Ready to Error");
}

TEST(OpticsMonitor, the_registers_show_it) {
    Line line;
    RegisterServerModel image({});
    HealthReport health;
    const auto show = [&] {
        health.optics = report_of(line.watch->view());
        image.publish(health);
        std::vector<std::uint16_t> words(17);
        EXPECT_EQ(image.read_registers(8434, words), modbus::Exception::none);
        return words;
    };
    const auto none = std::uint16_t{0xFFFF};
    const auto s32_none = std::uint16_t{0x8000};
    EXPECT_THAT(show(),
                ElementsAre(none, s32_none, 0, s32_none, none, none, none, none, none, none, none, none, none, s32_none,
                            0, s32_none, 0));
    line.watch->restart(0.2F);
    line.windows(1);
    line.light = 0.5;
    line.dark = 1;
    line.speck(30, 10, 0.5F);
    line.windows(1);
    const auto words = show();
    EXPECT_EQ(words[0], 875);     // light_output: a quarter of the step
    EXPECT_EQ(words[1], 0xFFFF);  // dark_drift -1.00 DN
    EXPECT_EQ(words[2], 0xFF9C);
    EXPECT_THAT(std::vector(words.begin() + 6, words.begin() + 17),
                ElementsAre(0, 1, 30, 10, 0, 1, 1000, 0, 2100, 0xFFFF, 0xFBB4));
}

TEST(OpticsMonitor, limits_follow_the_configuration_and_the_bit_depth) {
    OpticsConfig config;
    EXPECT_EQ(limits_of(config, 8).most_dark_drift_dn, 1);
    EXPECT_EQ(limits_of(config, 12).most_dark_drift_dn, 16);
    config.most_dark_drift_dn = 5;
    EXPECT_EQ(limits_of(config, 12).most_dark_drift_dn, 5);
}

}  // namespace
}  // namespace hord::firmware
