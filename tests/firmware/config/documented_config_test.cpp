// The documented file: every key at its default.
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "tests/firmware/config/parsed_config.h"

namespace hord::firmware {
namespace {

using test::kDeploy;
using test::parse;
using test::text_of;

TEST(Config, an_empty_file_is_the_defaults_and_they_can_be_used) {
    const auto config = parse("");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->core.transport, milliseconds(400));
    EXPECT_TRUE(std::holds_alternative<SimulatedSensor>(config->sensor));
    EXPECT_TRUE(std::holds_alternative<SimulatedRejector>(config->rejector));
    EXPECT_EQ(config->modbus.port, 1502);
}

// deploy/hordd.toml has every key at its default.
TEST(Config, the_documented_file_is_the_defaults) {
    const auto file = load_config(kDeploy / "hordd.toml");
    ASSERT_TRUE(file) << file.error().what;
    const Config defaults;
    EXPECT_EQ(file->name, defaults.name);
    const CoreConfig &a = file->core, &b = defaults.core;
    EXPECT_EQ(std::tie(a.by_encoder, a.transport, a.transport_counts, a.encoder_timeout, a.max_parts, a.min_gap,
                       a.exposure_delay, a.trigger_lead, a.exposure_counts, a.min_gap_counts, a.exposure,
                       a.strobe_delay, a.strobe, a.strobe_channels, a.strobe_window, a.frame_window, a.frame_timeout),
              std::tie(b.by_encoder, b.transport, b.transport_counts, b.encoder_timeout, b.max_parts, b.min_gap,
                       b.exposure_delay, b.trigger_lead, b.exposure_counts, b.min_gap_counts, b.exposure,
                       b.strobe_delay, b.strobe, b.strobe_channels, b.strobe_window, b.frame_window, b.frame_timeout));
    EXPECT_EQ(std::tie(a.reject_lead, a.reject_early, a.reject_pulse, a.confirm_timeout, a.max_failures_in_a_row,
                       a.station_heartbeat),
              std::tie(b.reject_lead, b.reject_early, b.reject_pulse, b.confirm_timeout, b.max_failures_in_a_row,
                       b.station_heartbeat));
    EXPECT_EQ(file->strobe, defaults.strobe);
    EXPECT_EQ(file->part_sensor, defaults.part_sensor);
    EXPECT_EQ(std::tie(file->modbus.host, file->modbus.port, file->modbus.read_only_port, file->modbus.max_connections),
              std::tie(defaults.modbus.host, defaults.modbus.port, defaults.modbus.read_only_port,
                       defaults.modbus.max_connections));
    ASSERT_EQ(file->modbus.access.size(), defaults.modbus.access.size());
    for (std::size_t k = 0; k < file->modbus.access.size(); ++k) {
        const auto &rule = file->modbus.access[k], &same = defaults.modbus.access[k];
        EXPECT_EQ(std::tie(rule.network.address, rule.network.prefix_bits, rule.may_write),
                  std::tie(same.network.address, same.network.prefix_bits, same.may_write));
    }
    EXPECT_FALSE(file->serial);
    EXPECT_EQ(std::tie(file->autostart, file->plc.timeout, a.plc_policy),
              std::tie(defaults.autostart, defaults.plc.timeout, b.plc_policy));
    EXPECT_EQ(
        std::tie(file->inspection.bins_i, file->inspection.bins_j, file->inspection.threads, file->inspection.queue),
        std::tie(defaults.inspection.bins_i, defaults.inspection.bins_j, defaults.inspection.threads,
                 defaults.inspection.queue));
    EXPECT_EQ(file->optics, defaults.optics);
}

// The same for the keys that a simulated backend does not use: switch the backends on, uncomment, compare.
TEST(Config, the_documented_keys_of_other_backends_are_known_and_at_their_defaults) {
    std::string text = text_of(kDeploy / "hordd.toml");
    const auto replace = [&](std::string_view from, std::string_view to) {
        const auto at = text.find(from);
        ASSERT_NE(at, std::string::npos) << from;
        text.replace(at, from.size(), to);
    };
    replace("backend = \"simulated\"          # \"simulated\", or \"modbus\"", "backend = \"modbus\" #");
    replace("backend = \"simulated\"          # \"simulated\", \"frames\"", "backend = \"frames\" #");
    replace("# folder =", "folder =");
    replace("# recipe =", "recipe =");
    const auto config = parse(text);
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<FrameFolder>(config->sensor).folder, "/etc/hord/frames");
    EXPECT_EQ(config->inspection.recipe, "/etc/hord/recipes/default.toml");
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(config->rejector), drivers::ModbusRejectorOptions{});
}

// The documented values that override a profile are those of the plain module.
TEST(Config, the_documented_keys_of_a_module_are_those_of_the_plain_profile) {
    const std::string text = text_of(kDeploy / "hordd.toml");
    const auto begin = text.find("# read_back_offset"), end = text.find("[modbus]");
    ASSERT_NE(begin, std::string::npos);
    std::istringstream lines(text.substr(begin, end - begin));
    std::string part = "[rejector]\nbackend = \"modbus\"\nprofile = \"wago-750\"\n";
    int keys = 0;
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("# ")) continue;
        part += line.substr(2) + "\n";
        ++keys;
    }
    EXPECT_EQ(keys, 10);
    const auto config = parse(part);
    ASSERT_TRUE(config) << config.error().what;
    drivers::ModuleMap map = std::get<drivers::ModbusRejectorOptions>(config->rejector).map;
    map.name_register = -1;  // the name is the profile's alone
    map.name_prefix = "";
    EXPECT_EQ(map, drivers::ModuleMap{});
}

// Every commented line of [sensor], [strobe] and [part_sensor], uncommented, is a driver's default.
TEST(Config, the_documented_keys_of_real_devices_are_known_and_at_their_defaults) {
    std::string text = text_of(kDeploy / "hordd.toml");
    const auto begin = text.find("\n[sensor]\n"), end = text.find("\n[rejector]\n");
    ASSERT_NE(begin, std::string::npos);
    ASSERT_NE(end, std::string::npos);
    std::istringstream lines(text.substr(begin, end - begin));
    std::string part, features = "[sensor]\nbackend = \"genicam\"\ntrigger = \"free\"\n";
    for (std::string line, table; std::getline(lines, line);) {
        if (line.starts_with("# folder") || line.starts_with("# scenes")) continue;
        if (line.starts_with("# ") && line.find("# gardasoft") != std::string::npos) continue;
        if (line.starts_with("# ")) line.erase(0, 2);
        if (line.starts_with("[")) table = line.substr(0, line.find(']'));
        if (line.starts_with("channels =")) continue;
        if (table == "[part_sensor" && line.starts_with("chip =")) line = "chip = \"label\"";
        if (table == "[part_sensor" && line.starts_with("line =")) line = "line = \"6\"";
        if (line.starts_with("backend =")) line = table == "[sensor" ? "backend = \"v4l2\"" : "backend = \"gpio\"";
        (table == "[[sensor.feature" ? features : part) += line + "\n";
    }
    const auto config = parse(part), camera = parse(features);
    ASSERT_TRUE(config) << config.error().what;
    ASSERT_TRUE(camera) << camera.error().what;
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(camera->sensor).features.size(), 1U);
    drivers::V4l2SensorOptions video;
    video.controls = {{"Exposure", 100}};
    EXPECT_EQ(config->sensor, SensorConfig(video));
    const StrobeConfig defaults;
    ASSERT_EQ(config->strobe.gpio.size(), 1U);
    EXPECT_EQ(config->strobe.gpio[0],
              (drivers::GpioStrobeChannel{{"pinctrl-bcm2711", "GPIO17", false, {}}, defaults.limits}));
    drivers::GpioPartSensorOptions barrier;
    barrier.line = {"label", "6", false, {}};
    barrier.encoder = {"pinctrl-bcm2711", "GPIO18", false, {}};
    EXPECT_EQ(config->part_sensor, PartSensorConfig(barrier));
}

}  // namespace
}  // namespace hord::firmware
