// The configuration: defaults, correct documentation, all problems reported at once.
#include "firmware/config/config.h"

#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;

Result<Config> parse(std::string_view text) {
    return parse_config(text, "cell.toml", "/etc/hord", NamedBackends::optional);
}
std::string problems_of(std::string_view text) {
    const auto config = parse(text);
    return config ? std::string("no problem") : config.error().what;
}
const std::filesystem::path kDeploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";

std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
}

TEST(Config, what_a_camera_or_its_backend_cannot_do_is_refused_by_the_check) {
    const std::string genicam = "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n";
    const std::pair<std::string, const char*> cases[] = {
        {genicam + "[[sensor.control]]\nname = \"Gain\"\nvalue = 1\n", "[[sensor.feature]]"},
        {genicam + "green = true\n", "only colour frames of libcamera"},
        {genicam + "device = \"/dev/video3\"\n", "name the camera in sensor.camera"},
        {"[sensor]\nbackend = \"v4l2\"\ncamera = \"A\"\n", "name the video device in sensor.device"},
        {genicam + "pixel_format = \"Mono9\"\n", "is no grey format"},
        {genicam + "pixel_format = \"Mono8\"\nbits = 12\n", "has samples of 8 bits, and sensor.bits is 12"},
        {genicam + "width_px = 1000\nheight_px = 999\n", "of 9x9 does not divide the frame"},
        {genicam + "width_px = 9\nheight_px = 999\n",
         "make a light field of 1x111 lenslets: use 3 to 2048 lenslets a side"},
        {genicam + "[[sensor.feature]]\nname = \"triggermode\"\nvalue = \"Off\"\n", "set sensor.trigger instead"},
        {genicam + "[[sensor.feature]]\nname = \"acquisitionstart\"\nvalue = true\n",
         "it sets AcquisitionStart by itself"},
        {genicam + "packet_bytes = 10\n", "is smaller than every GigE Vision camera's packets"},
        {genicam + "[[sensor.feature]]\nname = \"PixelFormat\"\nvalue = \"Mono8\"\n", "sensor.pixel_format instead"},
        {"[sensor]\nbackend = \"genicam\"\ntrigger_source = \"Software\"\n", "trigger to \"software\""},
        {"[sensor]\n[[sensor.control]]\nname = \"gain\"\nvalue = 1\n", "only cameras of v4l2 and libcamera"},
        {genicam + "[[sensor.feature]]\nname = \"TriggerMode\"\nvalue = \"Off\"\n", "set sensor.trigger instead"},
        {genicam + "[[sensor.feature]]\nname = \"AcquisitionStart\"\nvalue = true\n",
         "it sets AcquisitionStart by itself"},
        {genicam + "[[sensor.feature]]\nname = \"AcquisitionMode\"\nvalue = \"SingleFrame\"\n", "take it out"},
        {genicam + "[[sensor.feature]]\nname = \"Gain\"\nvalue = nan\n", "sensor.feature[0].value: is neither a text"},
        {genicam + "trigger_source = \"Line1\"\n", "trigger_source: has no effect with this sensor.trigger"},
        {genicam + "scenes = \"parts\"\n", "only the simulated sensor has scenes"},
    };
    for (const auto& [text, said] : cases) EXPECT_THAT(problems_of(text), HasSubstr(said)) << text;
    const std::string feature = "[[sensor.feature]]\nname = \"Gain\"\nvalue = 3\n";
    for (const char* backend : {"simulated", "frames", "v4l2", "libcamera"}) {
        const std::string text = std::string("[sensor]\nfolder = \"f\"\nbackend = \"") + backend + "\"\n";
        EXPECT_THAT(problems_of(text + feature), HasSubstr("sensor.feature: has no effect with this backend")) << text;
    }
    const std::string video = "[sensor]\nbackend = \"v4l2\"\n";
    for (const char* line : {"offset_x_px = 8", "offset_y_px = 8", "pixel_format = \"Mono8\"", "trigger = \"software\"",
                             "trigger_source = \"Line1\"", "packet_bytes = 1500", "socket_buffer_bytes = 1000000"}) {
        const std::string key = std::string(line).substr(0, std::string(line).find(' '));
        EXPECT_THAT(problems_of(video + line + "\n"), HasSubstr("sensor." + key + ": has no effect")) << line;
    }
    const std::string every_key_at_its_default = "device = \"/dev/video0\"\ngreen = false\ncamera = \"\"\n";
    EXPECT_TRUE(parse_config(genicam + every_key_at_its_default, "test.toml", {}, NamedBackends::optional));
    EXPECT_TRUE(parse_config(genicam + "width_px = 1000\nheight_px = 999\n[inspection]\ngrid = \"grid.toml\"\n",
                             "test.toml", {}, NamedBackends::optional));
}

// A key that is set and has no effect is refused: who set it believes that it has one.
TEST(Config, keys_of_another_light_barrier_or_module_are_refused) {
    const std::string camera =
        "[timing]\nstrobe_delay_us = 0\n[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n";
    const std::string channel = "[[strobe.channel]]\nchip = \"soc\"\nline = \"A\"\n";
    const std::string gpio = "[strobe]\nbackend = \"gpio\"\n";
    const std::string gardasoft = "[strobe]\nbackend = \"gardasoft\"\nhost = \"h\"\ntrigger = \"command\"\n";
    const std::string output = "[[strobe.channel]]\noutput = 1\nrated_ma = 500\n";
    const std::string barrier = camera + "[part_sensor]\nbackend = \"camera\"\ncamera_line = \"Line1\"\n";
    const std::string module = "[rejector]\nbackend = \"modbus\"\n";
    const std::pair<std::string, const char*> cases[] = {
        {"[strobe]\nhost = \"h\"\n", "strobe.host: has no effect with this backend"},
        {"[strobe]\n" + channel, "strobe.channel: has no effect"},
        {gpio + "camera_line = \"Line2\"\n" + channel, "strobe.camera_line: has no effect"},
        {gpio + channel + "output = 1\n", "strobe.channel[0].output: has no effect"},
        {gardasoft + output + "chip = \"soc\"\n", "chip: has no effect with strobe.trigger = \"command\""},
        {gardasoft + output + "line = \"A\"\n", "line: has no effect with strobe.trigger = \"command\""},
        {barrier + "debounce_us = 500\n", "a feature such as LineDebouncerTime"},
        {barrier + "chip = \"soc\"\n", "part_sensor.chip: has no effect"},
        {"[part_sensor]\nline = \"6\"\n", "part_sensor.line: has no effect"},
        {"[part_sensor]\ncamera_line = \"Line1\"\n", "part_sensor.camera_line: has no effect"},
        {module + "baud = 9600\n", "rejector.baud: has no effect without rejector.device"},
        {module + "device = \"/dev/ttyS0\"\nhost = \"h\"\n", "rejector.host: is given, and a serial line, too"},
        {module + "confirm_active_low = true\n", "confirm_active_low: has no effect without rejector.confirm_input"},
        {module + "confirm_within_ms = 20\n", "confirm_within_ms: has no effect without rejector.confirm_input"},
        {"[rejector]\nhost = \"h\"\n", "rejector.host: has no effect with this backend"},
        {"[rejector]\nport = 1502\n", "rejector.port: has no effect with this backend"},
    };
    for (const auto& [text, said] : cases) EXPECT_THAT(problems_of(text), HasSubstr(said)) << text;
    for (const std::string& good : {gpio + channel, gardasoft + output, barrier + "debounce_us = 200\n",
                                    module + "confirm_input = 0\nconfirm_within_ms = 20\nconfirm_active_low = true\n"})
        EXPECT_EQ(problems_of(good), "no problem") << good;
}

TEST(Config, an_address_is_a_host_and_a_rate_is_one_that_serial_lines_have) {
    for (const char* host : {"127.0.0.1:1600", "my module", "300.1.1.1", "1.2.3", "[::1]", "::1:zz", "a/b"}) {
        EXPECT_THAT(problems_of("[rejector]\nbackend = \"modbus\"\nhost = \"" + std::string(host) + "\"\n"),
                    HasSubstr("rejector.host: "))
            << host;
        EXPECT_THAT(problems_of("[modbus]\nhost = \"" + std::string(host) + "\"\n"), HasSubstr("modbus.host: "))
            << host;
        EXPECT_THAT(problems_of("[strobe]\nbackend = \"gardasoft\"\nhost = \"" + std::string(host) + "\"\n"),
                    HasSubstr("strobe.host: "))
            << host;
    }
    for (const char* host : {"127.0.0.1", "::1", "fe80::1%eth0", "localhost", "module-3.plant_a.example", "0.0.0.0"})
        EXPECT_EQ(problems_of("[modbus]\nhost = \"" + std::string(host) + "\"\n"), "no problem") << host;
    EXPECT_THAT(problems_of("[serial]\nbaud = 12345\n"), HasSubstr("serial.baud: is no rate"));
    EXPECT_THAT(problems_of("[rejector]\nbackend = \"modbus\"\ndevice = \"/dev/ttyS0\"\nbaud = 12345\n"),
                HasSubstr("rejector.baud: is no rate"));
}

TEST(Config, an_empty_file_is_the_defaults_and_they_can_be_used) {
    const auto config = parse("");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->core.transport, milliseconds(400));
    EXPECT_TRUE(std::holds_alternative<SimulatedSensor>(config->sensor));
    EXPECT_TRUE(std::holds_alternative<SimulatedRejector>(config->rejector));
    EXPECT_EQ(config->modbus.port, 1502);
}

// A file that was cut off anywhere, also to nothing, never means fewer real devices.
TEST(Config, a_file_that_names_fewer_than_all_devices_is_refused) {
    const std::string whole = text_of(kDeploy / "hordd.toml");
    const auto last = whole.find("backend", whole.find("[rejector]"));
    ASSERT_NE(last, std::string::npos);
    for (std::size_t end = 0; end < last; end = whole.find('\n', end) + 1) {
        const auto cut = parse_config(whole.substr(0, end), "cell.toml", "/etc/hord");
        ASSERT_FALSE(cut) << "cut off at " << end;
        EXPECT_THAT(cut.error().what, HasSubstr("rejector.backend: is missing"));
    }
    EXPECT_TRUE(parse_config(whole, "cell.toml", "/etc/hord"));
    for (const char* device : {"sensor", "strobe", "part_sensor", "rejector"}) {
        const std::string header = "\n[" + std::string(device) + "]\n";
        std::string without = whole;
        without.insert(without.find(header) + header.size(), "# ");
        const auto read = parse_config(without, "cell.toml", "/etc/hord");
        ASSERT_FALSE(read) << device;
        EXPECT_THAT(read.error().what, HasSubstr(std::string(device) + ".backend: is missing"));
    }
}

TEST(Config, the_time_of_an_inspection_is_unlimited_unless_it_is_said) {
    EXPECT_EQ(parse("")->inspection.budget, milliseconds(0));
    EXPECT_EQ(parse("[timing]\ninspect_budget_ms = 40\n")->inspection.budget, milliseconds(40));
    EXPECT_THAT(problems_of("[timing]\ninspect_budget_ms = -1\n"), HasSubstr("inspect_budget_ms"));
}

// The keys of a module also apply to the simulated module: an ignored time-out would stop the line.
TEST(Config, what_is_said_of_a_module_holds_for_the_simulated_one) {
    const auto config = parse("[rejector]\nresponse_timeout_ms = 500\nconfirm_timeout_ms = 501\nreject_coil = 7\n");
    ASSERT_TRUE(config) << config.error().what;
    const auto& module = std::get<SimulatedRejector>(config->rejector).module;
    EXPECT_EQ(module.response_timeout, milliseconds(500));
    EXPECT_EQ(module.ejector_coil, 7);
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

TEST(Config, a_camera_of_libcamera_is_named_with_its_format_and_controls) {
    const auto config = parse(
        "[sensor]\nbackend = \"libcamera\"\ncamera = \"/base/imx296\"\nwidth_px = 1440\nheight_px = 1080\nbits = "
        "10\nbuffers = 6\n"
        "green = true\n[[sensor.control]]\nname = \"ExposureTime\"\nvalue = 500\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<drivers::LibcameraSensorOptions>(config->sensor),
              (drivers::LibcameraSensorOptions{"/base/imx296", 1440, 1080, 10, 6, true, {{"ExposureTime", 500}}}));
    EXPECT_EQ(std::get<drivers::LibcameraSensorOptions>(parse("[sensor]\nbackend = \"libcamera\"\n")->sensor),
              drivers::LibcameraSensorOptions{});
}

TEST(Config, a_genicam_camera_is_named_with_its_region_trigger_and_features_in_order) {
    const auto config = parse(
        "[sensor]\nbackend = \"genicam\"\ncamera = \"40123456\"\nwidth_px = 1440\nheight_px = 1080\noffset_x_px = "
        "8\noffset_y_px = 6\nbits = 12\npixel_format = \"Mono12p\"\nbuffers = 6\ntrigger = \"line\"\n"
        "trigger_source = \"Line2\"\npacket_bytes = 8192\nsocket_buffer_bytes = 8000000\n"
        "[[sensor.feature]]\nname = \"LineSelector\"\nvalue = \"Line2\"\n[[sensor.feature]]\nname = \"ExposureTime\"\n"
        "value = 500.5\n[[sensor.feature]]\nname = \"GainRaw\"\nvalue = 3\n[[sensor.feature]]\nname = \"ReverseX\"\n"
        "value = true\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(config->sensor),
              (drivers::GenicamSensorOptions{
                  .camera = "40123456",
                  .width_px = 1440,
                  .height_px = 1080,
                  .offset_x_px = 8,
                  .offset_y_px = 6,
                  .bits = 12,
                  .pixel_format = "Mono12p",
                  .buffers = 6,
                  .trigger = drivers::CameraTrigger::line,
                  .trigger_source = "Line2",
                  .packet_bytes = 8192,
                  .socket_buffer_bytes = 8'000'000,
                  .exposure_us = 500,
                  .features = {
                      {"LineSelector", "Line2"}, {"ExposureTime", "500.5"}, {"GainRaw", "3"}, {"ReverseX", "true"}}}));
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(
                  parse("[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n")->sensor),
              (drivers::GenicamSensorOptions{.trigger = drivers::CameraTrigger::software, .exposure_us = 500}));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"genicam\"\n"), HasSubstr("sensor.trigger_source: is missing"));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"genicam\"\ntrigger = \"free\"\n[[sensor.feature]]\nvalue = [1]\n"),
                testing::AllOf(HasSubstr("name: is missing"), HasSubstr("value: is neither a text")));
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

TEST(Config, a_modules_profile_fills_its_addresses_and_each_can_be_overridden) {
    const auto wago = parse("[rejector]\nbackend = \"modbus\"\nprofile = \"wago-750\"\nwatchdog_ms = 500\n");
    ASSERT_TRUE(wago) << wago.error().what;
    const auto& module = std::get<drivers::ModbusRejectorOptions>(wago->rejector);
    EXPECT_EQ(module.map.read_back_offset, 512);
    EXPECT_EQ(module.map.watchdog_time_register, 0x1000);
    EXPECT_EQ(module.watchdog, milliseconds(500));
    const auto moxa =
        parse("[rejector]\nbackend = \"modbus\"\nprofile = \"moxa-iologik\"\nalarm_coil = -1\nmodule_pulse_ms = 12\n");
    ASSERT_TRUE(moxa) << moxa.error().what;
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(moxa->rejector).map.pulse_coil_offset, 16);
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(moxa->rejector).map.alarm_coil, -1);
    const auto adam = parse(
        "[rejector]\nbackend = \"modbus\"\nprofile = \"advantech-adam-6000\"\nreject_coil = 16\n"
        "run_permit_coil = 17\n");
    ASSERT_TRUE(adam) << adam.error().what;
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(adam->rejector).map.read_back_offset, 0);
    const auto serial = parse(
        "[rejector]\nbackend = \"modbus\"\ndevice = \"/dev/ttyUSB0\"\nbaud = 115200\nparity = \"odd\"\nrs485 = "
        "false\n");
    ASSERT_TRUE(serial) << serial.error().what;
    const auto& line = std::get<drivers::ModbusRejectorOptions>(serial->rejector).address.serial;
    ASSERT_TRUE(line);
    EXPECT_EQ(std::tie(line->device, line->baud, line->parity, line->rs485),
              std::make_tuple("/dev/ttyUSB0", 115200, 'O', false));
}

TEST(Config, what_a_module_cannot_do_is_refused_with_the_cure) {
    const auto wrong = [](const std::string& keys) { return problems_of("[rejector]\nbackend = \"modbus\"\n" + keys); };
    EXPECT_THAT(wrong("profile = \"wago\"\n"),
                HasSubstr("use one of plain-coils, wago-750, moxa-iologik, advantech-adam-6000"));
    EXPECT_THAT(wrong("watchdog_ms = 500\n"), HasSubstr("cannot be set in this module"));
    EXPECT_THAT(wrong("profile = \"wago-750\"\nwatchdog_ms = 60\n"),
                HasSubstr("shorter than three response_timeout_ms"));
    EXPECT_THAT(wrong("module_pulse_ms = 10\n"), HasSubstr("does not time"));
    EXPECT_THAT(wrong("profile = \"moxa-iologik\"\nmodule_pulse_ms = 16\n"), HasSubstr("is longer than pulse_ms"));
    EXPECT_THAT(wrong("profile = \"moxa-iologik\"\nmodule_pulse_ms = 10\nenergise_to = \"pass\"\n"),
                HasSubstr("pulses an output on"));
    const std::string adam = "profile = \"advantech-adam-6000\"\n";
    const std::string moxa = "profile = \"moxa-iologik\"\n";
    const std::pair<std::string, const char*> taken[] = {
        {moxa + "run_permit_coil = 16\n", "run_permit_coil: is 16, which starts the pulses of output 0"},
        {moxa + "run_permit_coil = 17\nmodule_pulse_ms = 10\n", "run_permit_coil: is 17, which starts the pulses"},
        {moxa + "reject_coil = 31\n", "reject_coil: is 31, which starts the pulses of output 15"},
        {moxa + "run_permit_coil = 4144\n", "run_permit_coil: is 4144, which is this module's alarm coil"},
        {moxa + "reject_coil = 4144\n", "reject_coil: is 4144, which is this module's alarm coil"},
        {"pulse_coil_offset = 1\nmodule_pulse_ms = 10\n", "run_permit_coil: is 1, which starts the pulses of output 0"},
        {"pulse_coil_offset = 3\nreject_coil = 9\nrun_permit_coil = 6\n", "reject_coil: is 9, which starts the pulses"},
        {"profile = \"wago-750\"\nrun_permit_coil = 512\n", "which is output 0 of this module, as it is read back"}};
    for (const auto& [keys, said] : taken) EXPECT_THAT(wrong(keys), HasSubstr(said)) << keys;
    for (const char* keys : {"run_permit_coil = 15\n", "reject_coil = 32\n", "run_permit_coil = 4145\n"})
        EXPECT_EQ(wrong(moxa + keys), "no problem") << keys;
    EXPECT_THAT(wrong(adam),
                AllOf(HasSubstr("reject_coil: is 0, which is an input of this module"),
                      HasSubstr("run_permit_coil: is 1, which is an input"), HasSubstr("its first output is coil 16")));
    EXPECT_THAT(wrong(adam + "reject_coil = 16\nrun_permit_coil = 17\nwatchdog_ms = 500\n"),
                HasSubstr("cannot be set in this module"));
    EXPECT_THAT(wrong("confirm_input = 0\nconfirm_within_ms = 80\n"), HasSubstr("raise confirm_timeout_ms"));
    EXPECT_THAT(wrong("confirm_timeout_ms = 30\n"),
                HasSubstr("confirm_timeout_ms: is not longer than response_timeout_ms"));
    EXPECT_EQ(wrong("confirm_timeout_ms = 31\n"), "no problem");
    EXPECT_THAT(wrong("early_ms = 0\n"), HasSubstr("rejector.early_ms: 0 is out of range"));
    EXPECT_THAT(wrong("device = \"/dev/ttyS0\"\nunit = 0\n"), HasSubstr("use 1 to 247"));
    EXPECT_THAT(wrong("device = \"/dev/ttyS0\"\nport = 1502\n"), HasSubstr("either rejector.device, or host and port"));
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

TEST(Config, real_devices_are_told_everything_that_is_wrong_with_them_at_once) {
    const std::string all = problems_of(R"(
[sensor]
backend = "v4l2"
bits = 9
[[sensor.control]]
name = "Exposure"
[strobe]
backend = "gpio"
channels = 3
[[strobe.channel]]
chip = "soc"
line = "A"
max_on_us = 100
[[strobe.channel]]
chip = "soc"
line = "A"
duty = 0.1
[part_sensor]
backend = "gpio"
line = "BARRIER"
debounce_us = 20000
[line]
tracking = "time"
)");
    for (const char* what : {"sensor.bits: is no depth", "value: is missing", "strobe.channels: differs",
                             "the limit protects the LED", "lights another channel", "duty: is not a known key",
                             "part_sensor.chip: is missing", "debounce_us: ends after the exposure has begun"}) {
        EXPECT_THAT(all, HasSubstr(what));
    }
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gpio\"\n"), HasSubstr("describe every collimator"));
    EXPECT_THAT(problems_of("[strobe]\nmax_duty = 0.005\n"),
                HasSubstr("is exceeded by parts that follow at line.min_gap_ms"));
    EXPECT_THAT(
        problems_of(
            "[line]\ntracking = \"encoder\"\n[part_sensor]\nbackend = \"gpio\"\nchip = \"soc\"\nline = \"6\"\n"),
        HasSubstr("describe it in [part_sensor.encoder]"));
}

TEST(Config, every_collimator_has_limits_of_its_own_or_the_common_ones) {
    const auto config = parse(R"(
[strobe]
backend = "gpio"
lit = [0, 1]
min_rest_ms = 3
max_duty = 0.3
[[strobe.channel]]
chip = "soc"
line = "A"
[[strobe.channel]]
chip = "/dev/gpiochip3"
line = "4"
active_low = true
max_on_us = 400
min_rest_ms = 9
max_duty = 0.1
)");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.channels, 2);
    EXPECT_EQ(config->core.strobe_channels, 0b11U);
    EXPECT_EQ(config->strobe.gpio[0],
              (drivers::GpioStrobeChannel{{"soc", "A", false, {}}, {milliseconds(2), milliseconds(3), 0.3}}));
    EXPECT_EQ(
        config->strobe.gpio[1],
        (drivers::GpioStrobeChannel{{"/dev/gpiochip3", "4", true, {}}, {microseconds(400), milliseconds(9), 0.1}}));
}

TEST(Config, a_strobe_controller_has_its_address_its_outputs_and_its_trigger_lines) {
    const std::string head = "[strobe]\nbackend = \"gardasoft\"\n";
    const auto config = parse(head + R"(
host = "192.168.1.103"
delay_us = 30
lit = [1]
[[strobe.channel]]
output = 2
rated_ma = 500
brightness_percent = 150
max_ma = 800
chip = "soc"
line = "A"
[[strobe.channel]]
output = 1
rated_ma = 300
max_on_us = 400
chip = "soc"
line = "B"
)");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.channels, 2);
    EXPECT_EQ(config->core.strobe_channels, 0b10U);
    EXPECT_FALSE(config->strobe.simulated());
    ASSERT_TRUE(config->strobe.controller);
    const auto& [options, lines] = *config->strobe.controller;
    EXPECT_EQ(options.host, "192.168.1.103");
    EXPECT_EQ(options.port, 30313);
    EXPECT_EQ(options.delay, microseconds(30));
    EXPECT_EQ(options.pulse, config->core.strobe);
    EXPECT_EQ(options.channels[0], (drivers::GardasoftChannel{2, 500, 150, 800, {}}));
    EXPECT_EQ(options.channels[1],
              (drivers::GardasoftChannel{1, 300, 100, 0, {microseconds(400), milliseconds(5), 0.2}}));
    ASSERT_EQ(lines.size(), 2U);
    EXPECT_EQ(lines[1].line, "B");
    const auto serial = parse(head +
                              "device = \"/dev/ttyUSB1\"\ntrigger = \"command\"\n"
                              "[[strobe.channel]]\noutput = 1\nrated_ma = 500\n");
    ASSERT_TRUE(serial) << serial.error().what;
    EXPECT_EQ(serial->strobe.controller->gardasoft.device, "/dev/ttyUSB1");
    EXPECT_TRUE(serial->strobe.controller->triggers.empty());
}

TEST(Config, a_strobe_controller_that_would_hurt_a_light_or_cannot_be_found_is_refused_with_the_cure) {
    const auto wrong = [](const std::string& keys, const std::string& channel, const std::string& timing = {}) {
        return problems_of(timing + "[strobe]\nbackend = \"gardasoft\"\ntrigger = \"command\"\n" + keys +
                           "[[strobe.channel]]\n" + channel);
    };
    const std::string host = "host = \"h\"\n", good = "output = 1\nrated_ma = 500\n";
    EXPECT_THAT(wrong("", good), HasSubstr("strobe.host: is missing"));
    EXPECT_THAT(wrong(host + "device = \"/dev/ttyS0\"\n", good), HasSubstr("either strobe.host or strobe.device"));
    EXPECT_THAT(wrong(host, ""), AllOf(HasSubstr("name the controller's output"), HasSubstr("the light's label")));
    EXPECT_THAT(wrong(host, good + "brightness_percent = 200\n"), HasSubstr("1000 mA, above max_ma"));
    EXPECT_THAT(wrong(host, good + "brightness_percent = 400\nmax_ma = 2000\n"), HasSubstr("max_duty"));
    EXPECT_THAT(wrong(host, good + "[[strobe.channel]]\n" + good), HasSubstr("output of its own"));
    EXPECT_THAT(wrong(host, good + "min_rest_ms = 999.9\n"), HasSubstr("999 ms that the controller can wait"));
    EXPECT_THAT(wrong(host, good, "[timing]\nstrobe_us = 10\n"), HasSubstr("20 us to 999 ms"));
    EXPECT_THAT(wrong(host, good, "[timing]\nstrobe_us = 100.5\n"), HasSubstr("whole microseconds"));
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gardasoft\"\nhost = \"h\"\n"),
                HasSubstr("describe every collimator"));
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gardasoft\"\nhost = \"h\"\n[[strobe.channel]]\n" + good),
                HasSubstr("strobe.channel[0].chip: is missing"));
}

TEST(Config, a_light_on_the_cameras_output_is_told_to_the_camera) {
    const std::string good =
        "[timing]\nstrobe_delay_us = 0\nstrobe_us = 250\n[sensor]\nbackend = \"genicam\"\n"
        "trigger = \"software\"\n[strobe]\nbackend = \"camera\"\n";
    const auto config = parse(good + "camera_line = \"Line2\"\nmin_rest_ms = 7\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->strobe.camera_line, "Line2");
    EXPECT_FALSE(config->strobe.simulated());
    EXPECT_EQ(config->strobe.limits.min_rest, milliseconds(7));
    const auto& camera = std::get<drivers::GenicamSensorOptions>(config->sensor);
    EXPECT_EQ(camera.light_line, "Line2");
    EXPECT_EQ(camera.light_us, 250);

    EXPECT_THAT(problems_of(good), HasSubstr("name the camera's output"));
    const std::string line = "camera_line = \"Line2\"\n", camera_strobe = "[strobe]\nbackend = \"camera\"\n" + line;
    EXPECT_THAT(problems_of("[timing]\nstrobe_delay_us = 0\n" + camera_strobe), HasSubstr("sensor.trigger to"));
    EXPECT_THAT(problems_of(camera_strobe), HasSubstr("light and exposure are one"));
    EXPECT_THAT(problems_of(good + line + "channels = 2\n"), HasSubstr("a camera has one light"));
    EXPECT_THAT(problems_of(good + line + "max_on_us = 100\n"), HasSubstr("the limit protects the LED"));
    EXPECT_THAT(problems_of(good + line + "[[sensor.feature]]\nname = \"ExposureTime\"\nvalue = 100\n"),
                HasSubstr("sets the camera's ExposureTime"));
}

TEST(Config, a_light_barrier_on_the_cameras_input_is_told_to_the_camera) {
    const std::string camera = "[sensor]\nbackend = \"genicam\"\ntrigger = \"software\"\n";
    const std::string barrier = "[part_sensor]\nbackend = \"camera\"\n", line = "camera_line = \"Line1\"\n";
    const auto config = parse(camera + barrier + line + "active_low = true\n");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(std::get<CameraInput>(config->part_sensor), (CameraInput{"Line1", true}));
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(config->sensor).barrier_line, "Line1");

    EXPECT_THAT(problems_of(camera + barrier), HasSubstr("name the camera's input"));
    for (const char* sensor :
         {"", "[sensor]\nbackend = \"v4l2\"\n", "[sensor]\nbackend = \"frames\"\nfolder = \"f\"\n"})
        EXPECT_THAT(problems_of(sensor + barrier + line),
                    HasSubstr("part_sensor.backend: needs a GenICam camera: set sensor.backend to \"genicam\""));
    EXPECT_THAT(problems_of(camera + barrier + line + "[line]\ntracking = \"encoder\"\n"), HasSubstr("has no encoder"));
    EXPECT_THAT(problems_of("[timing]\nstrobe_delay_us = 0\n" + camera + barrier + line +
                            "[strobe]\nbackend = \"camera\"\n" + line),
                HasSubstr("lines of their own"));
}

// Long because it is the list of all keys.
TEST(Config, scenes_of_the_simulated_sensor_lie_beside_the_file_and_are_no_keys_of_a_camera) {
    const auto scenes = parse("[sensor]\nbackend = \"simulated\"\nscenes = \"parts\"\n");
    ASSERT_TRUE(scenes) << scenes.error().what;
    EXPECT_EQ(std::get<SimulatedSensor>(scenes->sensor).scenes, "/etc/hord/parts");
    const auto without = parse("[sensor]\nbackend = \"simulated\"\n");
    ASSERT_TRUE(without);
    EXPECT_TRUE(std::get<SimulatedSensor>(without->sensor).scenes.empty());
}

TEST(Config, every_key_reaches_its_field) {
    const auto config = parse(R"(
[station]
name = "line 4"
heartbeat_ms = 250
max_failures_in_a_row = 3
[line]
tracking = "encoder"
transport_counts = 12345
encoder_timeout_ms = 50
exposure_delay_ms = 7.5
min_gap_ms = 40
max_parts = 9
[timing]
exposure_us = 900
strobe_delay_us = 50.5
strobe_us = 800
[strobe]
channels = 4
lit = [0, 3]
[rejector]
backend = "modbus"
host = "10.0.0.7"
port = 5020
unit = 3
reject_coil = 17
run_permit_coil = 18
energise_to = "pass"
response_timeout_ms = 45
pulse_ms = 30
[modbus]
port = 0
read_only_port = 5021
may_write = ["10.0.0.0/8"]
may_read = []
max_connections = 5
[serial]
device = "/dev/ttyS1"
baud = 115200
parity = "none"
unit = 17
rs485 = false
may_write = false
[plc]
policy = "reject_all"
timeout_ms = 750
[inspection]
recipes = "all"
macro = "7x5"
threads = 2
)");
    ASSERT_TRUE(config) << config.error().what;
    EXPECT_EQ(config->name, "line 4");
    EXPECT_EQ(config->core.station_heartbeat, milliseconds(250));
    EXPECT_EQ(config->core.max_failures_in_a_row, 3U);
    EXPECT_TRUE(config->core.by_encoder);
    EXPECT_EQ(config->core.transport_counts, 12345);
    EXPECT_EQ(config->core.exposure_delay, microseconds(7500));
    EXPECT_EQ(config->core.strobe_delay, Duration(50'500));
    EXPECT_EQ(config->core.strobe_channels, 0b1001U);
    EXPECT_EQ(config->core.max_parts, 9U);
    EXPECT_EQ(config->modbus.read_only_port, 5021);
    EXPECT_EQ(config->modbus.max_connections, 5U);
    ASSERT_EQ(config->modbus.access.size(), 1U);
    EXPECT_EQ(config->modbus.access[0].network.prefix_bits, 96 + 8);
    EXPECT_TRUE(config->modbus.access[0].may_write);
    ASSERT_TRUE(config->serial);
    EXPECT_EQ(config->serial->device, "/dev/ttyS1");
    EXPECT_EQ(config->serial->baud, 115200);
    EXPECT_EQ(config->serial->parity, firmware::modbus::SerialOptions::Parity::none);
    EXPECT_EQ(config->serial->unit, 17);
    EXPECT_FALSE(config->serial->rs485);
    EXPECT_FALSE(config->serial->may_write);
    EXPECT_EQ(config->core.plc_policy, PlcPolicy::reject_all);
    EXPECT_EQ(config->plc.timeout, milliseconds(750));
    EXPECT_EQ(config->inspection.recipes, "/etc/hord/all");
    const auto& modbus = std::get<drivers::ModbusRejectorOptions>(config->rejector);
    EXPECT_EQ(modbus.address.host, "10.0.0.7");
    EXPECT_EQ(modbus.address.port, 5020);
    EXPECT_EQ(modbus.address.unit, 3);
    EXPECT_EQ(modbus.ejector_coil, 17);
    EXPECT_TRUE(modbus.energise_to_pass);
    EXPECT_EQ(modbus.response_timeout, milliseconds(45));
    EXPECT_EQ(config->inspection.bins_i, 7);
    EXPECT_EQ(config->inspection.bins_j, 5);
}

TEST(Config, all_problems_are_told_at_once_with_line_and_cure) {
    const std::string what =
        problems_of("[line]\ntransprt_ms = 300\nmax_parts = 0\n[timing]\nexposure_us = \"long\"\n");
    EXPECT_THAT(what, HasSubstr("cell.toml:2: line.transprt_ms: is not a known key: did you mean transport_ms?"));
    EXPECT_THAT(what, HasSubstr("cell.toml:3: line.max_parts: 0 is out of range: use 1 to 256"));
    EXPECT_THAT(what, HasSubstr("cell.toml:5: timing.exposure_us: is not a number"));
}

TEST(Config, a_misspelled_table_is_told_before_the_backend_that_is_missing_without_it) {
    const auto config = parse_config("[strobee]\nbackend = \"simulated\"\n[sensor]\nbackend = \"simulated\"\n",
                                     "cell.toml", "/etc/hord", NamedBackends::required);
    ASSERT_FALSE(config);
    const std::string& what = config.error().what;
    EXPECT_THAT(what, testing::StartsWith("cell.toml:1: strobee: is not a known key: did you mean strobe?\n"));
    EXPECT_THAT(what, HasSubstr("strobe.backend: is missing"));
}

TEST(Config, a_simulated_device_beside_a_real_one_that_it_does_not_work_with_is_noted) {
    const auto noted = [](const std::string& text) {
        const auto config = parse(text);
        if (!config) return config.error().message();
        std::string all;
        for (const Error& note : notes(*config)) all += note.message() + "\n";
        return all;
    };
    const std::string gardasoft =
        "[strobe]\nbackend = \"gardasoft\"\nhost = \"10.0.0.2\"\ntrigger = \"command\"\n[[strobe.channel]]\noutput = "
        "1\nrated_ma = 500\n";
    const std::string gpio = "[strobe]\nbackend = \"gpio\"\n[[strobe.channel]]\nchip = \"c\"\nline = \"1\"\n";
    const std::string frames = "[sensor]\nbackend = \"frames\"\nfolder = \"f\"\n",
                      genicam = "[sensor]\nbackend = \"genicam\"\n";
    for (const std::string& strobe : {gardasoft, gpio})
        EXPECT_THAT(noted(strobe),
                    testing::AllOf(HasSubstr("every part is rejected as too-dark"),
                                   HasSubstr("set strobe.backend to \"simulated\"")));
    EXPECT_THAT(noted(genicam + "trigger_source = \"Line1\"\n"), HasSubstr("no frame comes"));
    EXPECT_THAT(noted("[sensor]\nbackend = \"v4l2\"\n"), HasSubstr("no light of this station falls on the parts"));
    EXPECT_EQ(noted(genicam + "trigger_source = \"Line1\"\n" + gpio), "");
    EXPECT_EQ(noted(frames), "");
    EXPECT_EQ(noted(frames + gpio), "");
    EXPECT_EQ(noted(""), "");
    const auto first_try = load_config(kDeploy / "try-genicam.toml");
    ASSERT_TRUE(first_try) << first_try.error().message();
    ASSERT_EQ(notes(*first_try).size(), 1U);
    EXPECT_THAT(notes(*first_try)[0].cure, HasSubstr("for a trial"));
}

TEST(Config, what_cannot_work_together_is_refused) {
    EXPECT_THAT(problems_of("[line]\ntransport_ms = 100\n"), HasSubstr("the verdict is due 75 ms after the edge"));
    EXPECT_THAT(problems_of("[rejector]\npulse_ms = 20\n"), HasSubstr("else a neighbour is ejected"));
    EXPECT_THAT(problems_of("[rejector]\nearly_ms = 15\n"), HasSubstr("shorten early_ms"));
    EXPECT_THAT(problems_of("[timing]\nexposure_us = 21000\n"), HasSubstr("an exposure takes 21 ms"));
    EXPECT_THAT(problems_of("[line]\ntracking = \"encoder\"\nexposure_counts = 4000\n"),
                HasSubstr("lies behind the ejector"));
    EXPECT_THAT(problems_of("[timing]\nframe_window_us = 10000\n"), HasSubstr("a frame may belong to two parts"));
    EXPECT_THAT(problems_of("[timing]\nstrobe_us = 450\n"),
                HasSubstr("the light ends 0.55 ms after the exposure's start"));
    EXPECT_THAT(problems_of("[strobe]\nmax_on_us = 100\n"), HasSubstr("shorten the pulse; the limit protects the LED"));
    EXPECT_THAT(problems_of("[strobe]\nlit = [1]\n"), HasSubstr("names a channel that does not exist"));
    EXPECT_THAT(problems_of("[rejector]\nreject_coil = 1\n"), HasSubstr("give each output a coil of its own"));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"frames\"\n"), HasSubstr("name the folder of the recorded frames"));
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"camera\"\n"), HasSubstr("use one of simulated, frames"));
    for (const char* macro : {"9", "9x", "x9", "9x9x9", "2x9", "16x9", "nine"}) {
        EXPECT_THAT(problems_of(std::string("[inspection]\nmacro = \"") + macro + "\"\n"),
                    HasSubstr("is not a macro-pixel"))
            << macro;
    }
}

TEST(Config, one_typo_is_told_once) {
    EXPECT_EQ(
        problems_of("[sensor]\nbackend = \"genicam\"\ntrigger = \"softwar\"\n"
                    "[strobe]\nbackend = \"camera\"\ncamera_line = \"Line2\"\n"
                    "[part_sensor]\nbackend = \"camera\"\ncamera_line = \"Line1\"\n"),
        "cell.toml:3: sensor.trigger: \"softwar\" is not known: did you mean software? It is one of line, software, "
        "free");
    EXPECT_EQ(
        problems_of("[sensor]\nbackend = \"genicm\"\ncamera = \"S1\"\n[[sensor.feature]]\nname = \"Gain\"\nvalue = 1\n"
                    "[strobe]\nbackend = \"camera\"\ncamera_line = \"Line2\"\n"),
        "cell.toml:2: sensor.backend: \"genicm\" is not known: did you mean genicam? It is one of simulated, frames, "
        "v4l2, libcamera, genicam");
    EXPECT_EQ(problems_of("[strobe]\nbackend = \"gpoi\"\n[[strobe.channel]]\nchip = \"a\"\nline = \"1\"\n"),
              "cell.toml:2: strobe.backend: \"gpoi\" is not known: did you mean gpio? It is one of simulated, gpio, "
              "gardasoft, camera");
}

TEST(Config, a_missing_file_and_broken_toml_are_named) {
    const auto missing = load_config("/nowhere/cell.toml");
    ASSERT_FALSE(missing);
    EXPECT_THAT(missing.error().what, HasSubstr("/nowhere/cell.toml: cannot be read"));
    EXPECT_THAT(problems_of("[line\n"), HasSubstr("cell.toml:1: not valid TOML"));
}

TEST(Notes, tell_of_a_name_that_registers_cut) {
    Config config;
    config.name = "Zelle Süd";
    EXPECT_THAT(notes(config), ::testing::IsEmpty());
    config.name = "Glas für die Linsen der Zelle Süd";
    const auto told = notes(config);
    ASSERT_EQ(told.size(), 1U);
    EXPECT_THAT(told[0].message(),
                ::testing::HasSubstr(
                    "station.name has 35 bytes, and registers hold 32 of them (\"Glas für die Linsen der Zelle "
                    "S\"): shorten it"));
}

}  // namespace
}  // namespace hord::firmware
