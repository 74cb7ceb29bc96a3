// The configuration as a whole: all keys, all problems reported at once, what cannot work together.
#include "firmware/config/config.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/firmware/config/parsed_config.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using test::kDeploy;
using test::parse;
using test::problems_of;
using test::text_of;
using ::testing::HasSubstr;

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
    EXPECT_THAT(problems_of("[sensor]\nbackend = \"v4l2\"\nbits = 14\n"),
                HasSubstr("sensor.bits: is no depth that the station reads: use 8, 10, 12 or 16, and set the camera"));
    EXPECT_THAT(problems_of("[strobe]\nbackend = \"gpio\"\n"), HasSubstr("describe every collimator"));
    EXPECT_THAT(problems_of("[strobe]\nmax_duty = 0.005\n"),
                HasSubstr("is exceeded by parts that follow at line.min_gap_ms"));
    EXPECT_THAT(
        problems_of(
            "[line]\ntracking = \"encoder\"\n[part_sensor]\nbackend = \"gpio\"\nchip = \"soc\"\nline = \"6\"\n"),
        HasSubstr("describe it in [part_sensor.encoder]"));
}

// Long because it is the list of all keys.
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

TEST(Notes, tell_of_a_file_that_may_have_lost_its_end) {
    const testing_support::TempFolder folder;
    const auto file = folder.path() / "c.toml";
    const auto told = [&](const std::string& text) {
        std::ofstream(file) << text;
        const auto config = load_config(file, NamedBackends::optional);
        std::string all;
        for (const Error& note : notes(config.value())) all += note.message();
        return all;
    };
    EXPECT_EQ(told("[line]\ntransport_ms = 1500\n"), "");
    EXPECT_EQ(told("[line]\ntransport_ms = 1500"),
              file.string() +
                  ":2: the last line has no line end, so the file may have lost its end, and defaults count for what "
                  "is lost: compare it with its original, and end it with a line end");
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
