// The commands and answers of drivers/gardasoft/gardasoft_protocol.h, with the manual's own examples.
#include "drivers/gardasoft/gardasoft_protocol.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::drivers::gardasoft {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;

const GardasoftChannel kChannel{
    .output = 2, .rated_ma = 500, .brightness_percent = 150, .max_ma = 800, .limits = {2ms, 5ms, 0.2}};

TEST(GardasoftProtocol, commands_are_those_of_the_manual) {
    EXPECT_EQ(rating_command(kChannel), "VL2,0,0.500A");
    EXPECT_EQ(dark_command(kChannel), "RS2,0");
    // 1 ms, then at least 5 ms: a trigger before 6 ms is ignored.
    EXPECT_EQ(pulse_command(kChannel, 1ms, 20us), "RT2,1.000,0.020,150.0,6.0");
    // The duty limit asks for more rest: 2 ms + 8 ms. 1.11 ms + 5 ms is rounded down to whole 0.1 ms.
    EXPECT_EQ(pulse_command(kChannel, 2ms, 20us), "RT2,2.000,0.020,150.0,10.0");
    EXPECT_EQ(pulse_command(kChannel, 1110us, 20us), "RT2,1.110,0.020,150.0,6.1");
    GardasoftStrobeOptions options;
    options.channels = {kChannel, kChannel};
    options.channels[0].output = 4;
    EXPECT_EQ(trigger_command(options, 0b11), "TR4;TR2");
    EXPECT_EQ(trigger_command(options, 0b10), "TR2");
}

TEST(GardasoftProtocol, an_answer_is_read_with_and_without_echo) {
    EXPECT_EQ(text_of_reply("VR", "VRRT420-20 (HW02) V031\n\r>").value(), "RT420-20 (HW02) V031");
    EXPECT_EQ(text_of_reply("VR", "RT420-20 (HW02) V031\r\n>").value(), "RT420-20 (HW02) V031");
    EXPECT_EQ(text_of_reply("GR", "GR\n\r>").value(), "");
    EXPECT_EQ(text_of_reply("GR", ">").value(), "");
}

TEST(GardasoftProtocol, an_error_says_the_command_the_number_and_the_cure) {
    const auto invalid = text_of_reply("TR3", "TR3Err 1\n\r>");
    ASSERT_FALSE(invalid);
    EXPECT_EQ(invalid.error().code, ErrorCode::refused);
    EXPECT_THAT(invalid.error().message(), HasSubstr("\"TR3\" with Err 1"));
    EXPECT_THAT(invalid.error().cure, HasSubstr("fewer outputs"));
    const Error changed = text_of_reply("RT1,1,0,50", "Err 5\r\n>").error(),
                other = text_of_reply("GR", "Err 5>").error();
    EXPECT_THAT(changed.message(), AllOf(HasSubstr("changed a value"), HasSubstr("within its ranges")));
    EXPECT_THAT(other.message(), AllOf(HasSubstr("changed a value"), HasSubstr("switch it off and on")));
    EXPECT_THAT(text_of_reply("XX", "Err 2>").error().cure, HasSubstr("RT series"));
    const Error unknown = text_of_reply("RS1,0", "RS1,0Err 17\n\r>").error();
    EXPECT_THAT(unknown.message(), AllOf(HasSubstr("\"RS1,0\" with Err 17"), HasSubstr("controller's manual")));
    EXPECT_EQ(text_of_reply("VR", "VR").error().code, ErrorCode::unreadable);
}

TEST(GardasoftProtocol, the_settings_of_a_channel_are_read_as_the_manual_prints_them) {
    const auto state = parse_channel("CH1,MD0,S 50.0, 0.0,DL1.000ms,PU1.000ms,RT 0.0us,IP1,FL0,CS0.000A,RA0.000A");
    ASSERT_TRUE(state) << state.error().message();
    EXPECT_EQ(state->output, 1);
    EXPECT_EQ(state->mode, ChannelState::Mode::continuous);
    EXPECT_EQ(state->percent, 50.0);
    EXPECT_EQ(state->delay, 1ms);
    EXPECT_EQ(state->pulse, 1ms);
    EXPECT_EQ(state->retrigger, 0ns);
    const auto other = parse_channel("CH8,MD1,S999.0, 0.0,DL 20.0us,PU 0.200ms,RT1.5ms,IP2,FL4,CS0.480A,RA0.500A");
    ASSERT_TRUE(other) << other.error().message();
    EXPECT_EQ(other->delay, 20us);
    EXPECT_EQ(other->retrigger, 1500us);
    EXPECT_EQ(other->rated_a, 0.5);
}

TEST(GardasoftProtocol, what_is_no_text_is_quoted_as_text) {
    EXPECT_EQ(parse_channel(std::string_view("a\xff\0\r\n", 5)).error().what,
              "the strobe controller describes a channel as \"a\\xff\\x00\\r\\n\"");
}

TEST(GardasoftProtocol, settings_that_are_cut_or_changed_are_unreadable) {
    const std::string whole = "CH1,MD1,S 50.0, 0.0,DL1.000ms,PU1.000ms,RT 0.0us,IP1,FL0,CS0.000A,RA0.500A";
    ASSERT_TRUE(parse_channel(whole));
    for (std::size_t size = 0; size < whole.find("RA0."); ++size)
        EXPECT_FALSE(parse_channel(whole.substr(0, size))) << size;
    // A field that is there twice does not stand for one that is missing.
    for (const char* bad : {"CH1,CH1,S 50.0,DL1.000ms,PU1.000ms,RT 0.0us,RA0.5A", "", "MD1", "CHx",
                            "CH1,MD9,S 50.0, 0.0,DL1.000ms,PU1.000ms,RT 0.0us,IP1,FL0,RA0.5A",
                            "CH1,MD1,S 50.0, 0.0,DL1.000km,PU1.000ms,RT 0.0us,IP1,FL0,RA0.5A",
                            "CH1,MD1,S nan, 0.0,DL1e99s,PU1.000ms,RT 0.0us,IP1,FL0,RA0.5A"})
        EXPECT_FALSE(parse_channel(bad)) << bad;
}

TEST(GardasoftProtocol, each_setting_that_differs_is_named) {
    const ChannelState set{2, ChannelState::Mode::pulse, 150, 20us, 1ms, 6ms, 0.5};
    EXPECT_EQ(difference(set, kChannel, 1ms, 20us), "");
    const auto with = [&](auto change) {
        ChannelState state = set;
        change(state);
        return difference(state, kChannel, 1ms, 20us);
    };
    EXPECT_THAT(with([](auto& s) { s.output = 1; }), HasSubstr("output 1"));
    EXPECT_THAT(with([](auto& s) { s.mode = ChannelState::Mode::continuous; }), HasSubstr("pulse mode"));
    EXPECT_THAT(with([](auto& s) { s.percent = 151; }), HasSubstr("brightness"));
    EXPECT_THAT(with([](auto& s) { s.pulse = 1002us; }), HasSubstr("pulse"));
    EXPECT_THAT(with([](auto& s) { s.delay = 30us; }), HasSubstr("delay"));
    EXPECT_THAT(with([](auto& s) { s.retrigger = 1ms; }), HasSubstr("retrigger"));
    EXPECT_THAT(with([](auto& s) { s.rated_a = 1; }), HasSubstr("rated"));
}

TEST(GardasoftProtocol, events_that_are_errors_are_told_apart) {
    const auto of = [](std::string_view text) { return error_of_events("GR", text).value(); };
    EXPECT_EQ(of(""), std::nullopt);
    EXPECT_EQ(of("Evt1,128;"), std::nullopt);
    EXPECT_THAT(of("Evt0,130;").value(), HasSubstr("too hot"));
    EXPECT_THAT(of("Evt2,45").value(), HasSubstr("more current"));
    EXPECT_THAT(of("Evt1,128\n\rEvt8,140").value(), HasSubstr("duty cycle"));
    EXPECT_EQ(acknowledged("GR", "Evt2,45").error().code, ErrorCode::refused);
    EXPECT_THAT(acknowledged("RS1,0", "Evt2,45").error().message(), HasSubstr("more current"));
}

TEST(GardasoftProtocol, an_answer_of_another_form_is_unreadable) {
    EXPECT_TRUE(acknowledged("VL1,0,0.500A", ""));
    for (const std::string_view text :
         {std::string_view("\x01\x02zz?!"), std::string_view("\0", 1), std::string_view("OK"), std::string_view(">"),
          std::string_view("RS2,0"), std::string_view("Evt1"), std::string_view("Evt1,"), std::string_view("Evt9,128"),
          std::string_view("Evt-1,128"), std::string_view("1,128"), std::string_view("Evt1,128x"),
          std::string_view("EvtEvt1,128")}) {
        EXPECT_EQ(acknowledged("RS1,0", text).error().code, ErrorCode::unreadable) << text;
    }
    for (const char* raw : {"RS1,0Err>", "RS1,0Err x>", "RS1,0Err 1x>", "RS1,0Err -1>"})
        EXPECT_EQ(text_of_reply("RS1,0", raw).error().code, ErrorCode::unreadable) << raw;
    EXPECT_THAT(text_of_reply("TR1;TR2", "TR1;TR2Err 2\n\rErr 1\n\r>").error().what, HasSubstr("Err 2"));
    EXPECT_EQ(text_of_reply("RS1,0", "zErr 1>").value(), "zErr 1");  // which acknowledges nothing
    EXPECT_FALSE(acknowledged("RS1,0", "zErr 1"));
    EXPECT_EQ(parse_version("RT420-20 (HW02) V031").value(), "RT420-20 (HW02) V031");
    EXPECT_TRUE(parse_version("TR-RT220-2 (HW101) V001"));
    for (const char* text : {"", "RT", "zz?!", "PP420 (HW001) V002", "RT420\x01 (HW02) V031", "RT420 V031"})
        EXPECT_EQ(parse_version(text).error().code, ErrorCode::unreadable) << text;
}

TEST(GardasoftOptions, the_manuals_limits_of_a_pulse_are_kept) {
    const auto key = [](double percent, int rated_ma, int max_ma, double duty, hal::Duration pulse) {
        return problem_of({1, rated_ma, percent, max_ma, {1s, 0ms, duty}}, pulse).key;
    };
    EXPECT_EQ(key(100, 500, 0, 1, 999ms), "");
    EXPECT_EQ(key(101, 500, 0, 0.3, 1ms), "brightness_percent");  // above max_ma, which is the rating
    EXPECT_EQ(key(200, 500, 1000, 0.3, 30ms), "");
    EXPECT_EQ(key(200, 500, 999, 0.3, 30ms), "brightness_percent");
    EXPECT_EQ(key(200, 500, 1000, 0.31, 30ms), "max_duty");
    EXPECT_EQ(key(200, 500, 1000, 0.3, 31ms), "brightness_percent");
    EXPECT_EQ(key(300, 500, 9000, 0.2, 10ms), "");
    EXPECT_EQ(key(500, 500, 9000, 0.1, 3ms), "brightness_percent");
    EXPECT_EQ(key(999, 500, 9000, 0.05, 1ms), "");
    EXPECT_EQ(key(999, 3000, 30'000, 0.01, 100us), "brightness_percent");  // 30 A
    EXPECT_EQ(key(600, 3000, 18'000, 0.05, 500us), "brightness_percent");  // 18 A for half a millisecond
    EXPECT_EQ(key(600, 3000, 18'000, 0.05, 400us), "");
    EXPECT_EQ(key(100, 600, 0, 0.2, 60us), "max_duty");  // too short to be measured
    EXPECT_EQ(key(100, 600, 0, 0.01, 60us), "");
}

}  // namespace
}  // namespace hord::drivers::gardasoft
