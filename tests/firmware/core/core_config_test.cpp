// problems(): each rule at its limit; and the names of commands and faults.
#include <functional>

#include <gmock/gmock.h>

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

struct Rule {
    const char* what;
    std::function<void(CoreConfig&)> allowed, refused;  // the last value on either side
    const char* said;
};

TEST(CoreConfig, every_rule_holds_up_to_its_limit) {
    const auto with_encoder = [](CoreConfig& c) { c.by_encoder = true; };
    const Rule rules[] = {
        {"exposure", [](CoreConfig& c) { c.exposure = microseconds(300); },
         [](CoreConfig& c) {
             c.exposure = Duration::zero();
             c.strobe = Duration(1);
             c.strobe_delay = Duration(-1);
         },
         "timing.exposure_us is 0 ms: give a time above 0"},
        {"strobe", [](CoreConfig& c) { c.strobe = Duration(1); }, [](CoreConfig& c) { c.strobe = Duration::zero(); },
         "timing.strobe_us is 0 ms: give a time above 0"},
        {"frame timeout", [](CoreConfig& c) { c.frame_timeout = Duration(1); },
         [](CoreConfig& c) { c.frame_timeout = Duration::zero(); },
         "timing.frame_timeout_ms is 0 ms: give a time above 0"},
        {"frame window", [](CoreConfig& c) { c.frame_window = Duration(1); },
         [](CoreConfig& c) { c.frame_window = milliseconds(-1); },
         "timing.frame_window_us is -1 ms: give a time above 0"},
        {"heartbeat", [](CoreConfig& c) { c.station_heartbeat = Duration(1); },
         [](CoreConfig& c) { c.station_heartbeat = Duration::zero(); },
         "station.heartbeat_ms is 0 ms: give a time above 0"},
        {"fewest parts", [](CoreConfig& c) { c.max_parts = 1; }, [](CoreConfig& c) { c.max_parts = 0; },
         "line.max_parts is 0: use 1 to 256"},
        {"most parts", [](CoreConfig& c) { c.max_parts = 256; }, [](CoreConfig& c) { c.max_parts = 257; },
         "line.max_parts is 257: use 1 to 256"},
        {"deadline", [](CoreConfig& c) { c.frame_timeout = milliseconds(155) - milliseconds(5) - microseconds(500); },
         [](CoreConfig& c) { c.frame_timeout = milliseconds(150); },
         "the verdict is due 155 ms after the edge (line.transport_ms less rejector.early_ms and lead_ms), the frame "
         "may "
         "come until 155.5 ms: shorten timing.frame_timeout_ms or move the ejector downstream (line.transport_ms)"},
        {"gap and exposure",
         [](CoreConfig& c) {
             c.exposure = c.min_gap;
             c.frame_timeout = milliseconds(100);
         },
         [](CoreConfig& c) {
             c.exposure = c.min_gap + microseconds(1);
             c.frame_timeout = milliseconds(100);
         },
         "line.min_gap_ms is 20 ms, an exposure takes 20.001 ms: raise line.min_gap_ms or shorten timing.exposure_us"},
        {"gap and pulse", [](CoreConfig& c) { c.reject_pulse = c.min_gap - Duration(1); },
         [](CoreConfig& c) { c.reject_pulse = c.min_gap; },
         "rejector.pulse_ms is 20 ms, parts may follow after 20 ms: shorten the pulse or raise line.min_gap_ms, else a "
         "neighbour is ejected"},
        {"early and pulse", [](CoreConfig& c) { c.reject_early = c.reject_pulse - Duration(1); },
         [](CoreConfig& c) { c.reject_early = c.reject_pulse; },
         "rejector.early_ms is 15 ms, the pulse is over after 15 ms: shorten early_ms or lengthen pulse_ms"},
        {"window and gap",
         [](CoreConfig& c) {
             c.exposure_delay = milliseconds(10);
             c.frame_window = c.min_gap / 2 - Duration(1);
         },
         [](CoreConfig& c) {
             c.exposure_delay = milliseconds(10);
             c.frame_window = c.min_gap / 2;
         },
         "timing.frame_window_us is 10 ms, half of line.min_gap_ms or more: shorten it, else a frame may belong to two "
         "parts"},
        {"window and edge", [](CoreConfig& c) { c.frame_window = c.exposure_delay; },
         [](CoreConfig& c) { c.frame_window = c.exposure_delay + Duration(1000); },
         "timing.frame_window_us is 5.001 ms, longer than line.exposure_delay_ms, 5 ms: shorten it, or set the camera "
         "further behind the part sensor and raise exposure_delay_ms: else it admits frames from before the part's own "
         "edge"},
        {"light and exposure", [](CoreConfig& c) { c.exposure = microseconds(300); },
         [](CoreConfig& c) { c.exposure = microseconds(299); },
         "the light ends 0.3 ms after the exposure's start, the exposure 0.299 ms: lengthen timing.exposure_us or "
         "shorten "
         "timing.strobe_us"},
        {"transport in counts",
         [&](CoreConfig& c) {
             with_encoder(c);
             c.transport_counts = 1;
             c.exposure_counts = 0;
         },
         [&](CoreConfig& c) {
             with_encoder(c);
             c.transport_counts = 0;
             c.exposure_counts = -1;
         },
         "line.transport_counts must be above 0 with an encoder"},
        {"exposure in counts",
         [&](CoreConfig& c) {
             with_encoder(c);
             c.exposure_counts = c.transport_counts - 1;
         },
         [&](CoreConfig& c) {
             with_encoder(c);
             c.exposure_counts = c.transport_counts;
         },
         "line.exposure_counts lies behind the ejector: lower it, or raise line.transport_counts"},
    };
    for (const Rule& rule : rules) {
        CoreConfig allowed = quick_line(), refused = quick_line();
        rule.allowed(allowed);
        rule.refused(refused);
        EXPECT_THAT(problems(allowed), IsEmpty()) << rule.what;
        EXPECT_THAT(problems(refused), ElementsAre(rule.said)) << rule.what;
    }
}

TEST(CoreConfig, a_pulse_of_no_time_is_refused) {
    CoreConfig config = quick_line();
    config.reject_pulse = Duration::zero();
    config.reject_early = Duration(-1);
    EXPECT_THAT(problems(config), ElementsAre("rejector.pulse_ms is 0 ms: give a time above 0"));
}

TEST(CoreConfig, counts_matter_with_an_encoder_only_and_the_deadline_without) {
    CoreConfig config = quick_line();
    config.transport_counts = 0;
    config.exposure_counts = 5;
    EXPECT_THAT(problems(config), IsEmpty());
    config = quick_line();
    config.by_encoder = true;
    config.transport = milliseconds(1);
    EXPECT_THAT(problems(config), IsEmpty());
}

TEST(Names, of_commands_are_read_with_both_separators) {
    EXPECT_EQ(hyphenated_name_of(Command::start_continuous), "start-continuous");
    EXPECT_EQ(command_named("start-continuous"), Command::start_continuous);
    EXPECT_EQ(command_named("start_continuous"), Command::start_continuous);
    EXPECT_EQ(command_named("halt"), Command::halt);
    EXPECT_EQ(command_named("continue"), std::nullopt);
    EXPECT_TRUE(is_state_command(Command::initialise) && is_state_command(Command::reset));
    EXPECT_FALSE(is_state_command(Command{0}) || is_state_command(Command{10}));
}

TEST(Names, of_faults_are_listed_lowest_first) {
    EXPECT_EQ(names_of_faults(0), "none");
    EXPECT_EQ(names_of_faults(kFaultStrobe), "strobe");
    EXPECT_EQ(names_of_faults(kFaultPlc | kFaultPartSensor), "part-sensor, plc-lost");
}

}  // namespace
}  // namespace hord::firmware
