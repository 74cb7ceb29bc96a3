// The simulated line that the factory makes of a configuration.
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {
namespace {

TEST(SimulatedLine, parts_follow_at_ten_a_second_or_at_twice_the_configured_gap) {
    CoreConfig core;
    EXPECT_DOUBLE_EQ(rate_of_line(core, 0), 10);
    core.min_gap = milliseconds(50);
    EXPECT_DOUBLE_EQ(rate_of_line(core, 0), 10);
    core.min_gap = milliseconds(120);
    EXPECT_DOUBLE_EQ(rate_of_line(core, 0), 1 / 0.24);
    EXPECT_DOUBLE_EQ(rate_of_line(core, 10), 10) << "a rate that is asked for";
    core.by_encoder = true;
    core.transport = milliseconds(1000);
    core.transport_counts = 10'000;
    core.min_gap_counts = 2500;  // a quarter of the way, 250 ms
    EXPECT_DOUBLE_EQ(rate_of_line(core, 0), 2);
}

TEST(SimulatedLine, of_the_configuration_for_a_first_try_keeps_its_gap) {
    const auto config = load_config(std::filesystem::path(HORD_SOURCE_DIR) / "deploy/try-genicam.toml");
    ASSERT_TRUE(config) << config.error().message();
    EXPECT_GE(1 / rate_of_line(config->core, 0), 0.24);
}

}  // namespace
}  // namespace hord::firmware
