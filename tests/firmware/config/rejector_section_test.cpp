// The section of the rejector: modules, their profiles, what they cannot do.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/config/config.h"
#include "tests/firmware/config/parsed_config.h"

namespace hord::firmware {
namespace {

using test::parse;
using test::problems_of;
using ::testing::HasSubstr;

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

// The keys of a module also apply to the simulated module: an ignored time-out would stop the line.
TEST(Config, what_is_said_of_a_module_holds_for_the_simulated_one) {
    const auto config = parse("[rejector]\nresponse_timeout_ms = 500\nconfirm_timeout_ms = 501\nreject_coil = 7\n");
    ASSERT_TRUE(config) << config.error().what;
    const auto& module = std::get<SimulatedRejector>(config->rejector).module;
    EXPECT_EQ(module.response_timeout, milliseconds(500));
    EXPECT_EQ(module.ejector_coil, 7);
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

}  // namespace
}  // namespace hord::firmware
