// PlcInterface: commands exactly once, heartbeat, acknowledgement, staged recipe.
#include "firmware/plc/plc_interface.h"

#include <deque>
#include <map>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/plc/register_server_model.h"

namespace hord::firmware {
namespace {

using modbus::Exception;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using namespace std::chrono_literals;
using Words = std::vector<std::uint16_t>;

class HandClock : public hal::Clock {
  public:
    hal::TimePoint at{};
    hal::TimePoint now() const override { return at; }
};

class Station : public PlcHandler {
  public:
    std::vector<CommandRequest> commands;
    std::vector<std::uint32_t> acknowledged;
    std::vector<std::string> writers;
    int lost = 0, back = 0;
    CommandOutcome answer;

    CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) override {
        commands.push_back(request);
        writers.emplace_back(origin.peer);
        return answer;
    }
    Exception taken = Exception::none;
    Exception on_acknowledged(const modbus::Origin&, std::uint32_t sequence) override {
        if (taken == Exception::none) acknowledged.push_back(sequence);
        return taken;
    }
    void on_plc_lost(PlcPolicy) override { ++lost; }
    void on_plc_back() override { ++back; }
};

class PlcSimulator : public ::testing::Test {
  protected:
    HandClock clock;
    Station station;
    PlcInterface plc_interface{clock, station, {.policy = PlcPolicy::stop, .timeout = 500ms, .boot_id = 0x1234B007}};
    RegisterServerModel image{StationIdentity{.boot_id = 0x1234B007}, &plc_interface};

    std::string peer = "192.0.2.7:50123";
    Exception write(std::uint16_t address, const Words& words) {
        return image.write_registers({.peer = peer}, address, words);
    }
    Exception command(std::uint32_t token, Command code, std::uint32_t argument = 0, std::uint16_t boot = 0,
                      std::uint16_t argument2 = 0) {
        const auto half = [](std::uint32_t v) { return static_cast<std::uint16_t>(v & 0xFFFFU); };
        return write(8002,
                     {half(token >> 16U), half(token), boot, static_cast<std::uint16_t>(code), half(argument >> 16U),
                      half(argument), 0, argument2});
    }
    Words read(std::uint16_t address, std::size_t count) {
        Words words(count);
        EXPECT_EQ(image.read_registers(address, words), Exception::none);
        return words;
    }
    std::uint32_t read32(std::uint16_t address) {
        const Words w = read(address, 2);
        return std::uint32_t{w[0]} << 16U | w[1];
    }
    void publish_results(std::uint32_t from, std::uint32_t to) {
        for (std::uint32_t s = from; s <= to; ++s) {
            PartResult result{.sequence = s, .part = s};
            Snapshot snapshot;
            snapshot.last = result;
            image.publish(snapshot);
        }
    }
};

// token, code, state, error
Words reply_of(const Words& block) { return {block[2], block[3], block[4], block[5], block[6]}; }

TEST_F(PlcSimulator, a_command_is_executed_and_replied_to) {
    ASSERT_EQ(command(0x00010002, Command::arm), Exception::none);
    ASSERT_EQ(station.commands.size(), 1U);
    EXPECT_EQ(station.commands[0].code, 2);
    EXPECT_THAT(station.writers, ElementsAre("192.0.2.7:50123"));
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(1, 2, 2, 2, 0));
    EXPECT_EQ(read32(8029), 1U);
}

TEST_F(PlcSimulator, a_repeated_token_does_nothing_and_shows_its_reply_again) {
    station.answer = {CommandState::failed, CommandError::device_down, 7};
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    station.answer = {};
    ASSERT_EQ(command(6, Command::reset), Exception::none);
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_EQ(station.commands.size(), 2U);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 2, 3, 3));
    EXPECT_EQ(read32(8027), 7U);
    EXPECT_EQ(read32(8029), 2U);
}

TEST_F(PlcSimulator, a_command_says_for_whom_it_is_sent) {
    const Words anna{0, 5, 0, 2, 0, 0, 0, 0, 'a' << 8 | 'n', 'n' << 8 | 'a', 0, 0, 0, 0, 0, 0, 0, 0};
    ASSERT_EQ(write(8002, anna), Exception::none);
    ASSERT_EQ(station.commands.size(), 1U);
    EXPECT_EQ(station.commands[0].who.view(), "anna");
    EXPECT_THAT(read(8000, 20)[10], 'a' << 8 | 'n');
    EXPECT_EQ(command(6, Command::arm), Exception::none);  // no name: the PLC commands for itself
    EXPECT_EQ(station.commands[1].who.view(), "");
    EXPECT_EQ(read(8000, 20)[10], 0);
}

TEST_F(PlcSimulator, the_heartbeats_coil_shows_its_lowest_bit) {
    for (const bool beat : {true, false, true}) {
        ASSERT_EQ(write(8102, {static_cast<std::uint16_t>(beat ? 7 : 8)}), Exception::none);
        bool coil = !beat;
        ASSERT_EQ(image.read_bits(80, {&coil, 1}), Exception::none);
        EXPECT_EQ(coil, beat);
    }
}

TEST_F(PlcSimulator, a_name_that_is_not_printable_or_not_whole_is_refused) {
    Words words{0, 5, 0, 2, 0, 0, 0, 0, 'a' << 8 | 'n', 'n' << 8 | '\n', 0, 0, 0, 0, 0, 0, 0, 0};
    EXPECT_EQ(write(8002, words), Exception::illegal_value);
    words[9] = 'n';  // a zero byte before a character
    EXPECT_EQ(write(8002, words), Exception::illegal_value);
    words[9] = 'n' << 8 | 0xE4;
    EXPECT_EQ(write(8002, words), Exception::illegal_value);
    words.resize(12);
    EXPECT_EQ(write(8002, words), Exception::illegal_value);
    EXPECT_THAT(station.commands, IsEmpty());
}

TEST_F(PlcSimulator, a_token_used_for_another_command_is_refused) {
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    ASSERT_EQ(command(5, Command::disarm), Exception::none);
    EXPECT_EQ(station.commands.size(), 1U);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 3, 3, 6));
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 2, 2, 0)) << "the first one keeps its reply";
}

// Two masters, or one whose counter began again, use the same token for the same command: the line must stop.
TEST_F(PlcSimulator, stop_abort_and_halt_act_whatever_their_token_and_boot) {
    for (const Command code : {Command::stop, Command::abort, Command::halt}) {
        station.commands.clear();
        const auto token = 10U + static_cast<std::uint32_t>(code);
        ASSERT_EQ(command(token, code), Exception::none);
        peer = "192.0.2.8:1";
        ASSERT_EQ(command(token, code), Exception::none);
        peer = "192.0.2.7:50124";
        ASSERT_EQ(command(token, code), Exception::none);
        EXPECT_EQ(station.commands.size(), 3U) << name_of(code);
        ASSERT_EQ(command(token + 20, Command::arm), Exception::none);
        ASSERT_EQ(command(token + 20, code), Exception::none) << "the token of another command";
        ASSERT_EQ(command(token + 40, code, 0, 0xB008), Exception::none) << "another boot";
        EXPECT_EQ(station.commands.size(), 6U) << name_of(code);
        EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, token + 40, static_cast<std::uint16_t>(code), 2, 0));
    }
}

TEST_F(PlcSimulator, a_repeated_stop_that_finds_nothing_to_stop_shows_the_first_reply) {
    ASSERT_EQ(command(5, Command::stop), Exception::none);
    station.answer = {CommandState::failed, CommandError::not_in_this_state, 0};
    ASSERT_EQ(command(5, Command::stop), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 6, 2, 0));
    EXPECT_EQ(read32(8029), 1U);
    ASSERT_EQ(command(6, Command::stop), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 6, 6, 3, 2)) << "a new one is told that nothing was running";
    EXPECT_EQ(read32(8029), 2U);
}

TEST_F(PlcSimulator, tokens_belong_to_a_client_whatever_its_connection) {
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    peer = "192.0.2.8:50123";
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_EQ(station.commands.size(), 2U) << "the second master's own command";
    peer = "192.0.2.7:60000";
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_EQ(station.commands.size(), 2U) << "the first one's repeat over a new connection";
}

TEST_F(PlcSimulator, clients_beyond_the_limit_share_tokens_and_repeat_nothing) {
    for (std::size_t k = 0; k < PlcInterface::kMaxClients + 3; ++k) {
        peer = "192.0.2." + std::to_string(k) + ":1";
        ASSERT_EQ(command(5, Command::arm), Exception::none);
    }
    EXPECT_EQ(station.commands.size(), PlcInterface::kMaxClients);
    ASSERT_EQ(command(6, Command::arm), Exception::none);
    EXPECT_EQ(station.commands.size(), PlcInterface::kMaxClients + 1);
}

TEST_F(PlcSimulator, an_old_token_is_refused_and_neither_executed_again_nor_called_completed) {
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    clock.at += PlcInterface::kReplyKept;
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 2, 2, 0));
    clock.at += hal::Duration(1);
    ASSERT_EQ(command(5, Command::arm), Exception::none);
    EXPECT_EQ(station.commands.size(), 1U);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 2, 3, 6));
}

TEST_F(PlcSimulator, a_token_is_not_executed_again_after_any_number_of_commands) {
    for (std::uint32_t token = 1; token <= 1000; ++token) ASSERT_EQ(command(token, Command::arm), Exception::none);
    for (const std::uint32_t token : {1U, 500U, 744U, 745U}) {
        ASSERT_EQ(command(token, Command::arm), Exception::none);
        EXPECT_EQ(read(8026, 1)[0], token > 744 ? 0 : 6) << token;
    }
    EXPECT_EQ(station.commands.size(), 1000U);
}

TEST_F(PlcSimulator, a_command_that_still_executes_is_shown_however_old_its_token) {
    station.answer = {CommandState::executing, CommandError::none, 0};
    ASSERT_EQ(command(5, Command::teach), Exception::none);
    station.answer = {};
    for (std::uint32_t token = 6; token <= 700; ++token) ASSERT_EQ(command(token, Command::reset), Exception::none);
    clock.at += 1h;
    ASSERT_EQ(command(5, Command::teach), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 21, 1, 0));
    plc_interface.finish(station.commands[0], {CommandState::completed, CommandError::none, 9});
    EXPECT_EQ(read32(8027), 9U) << "shown at once: it was written last";
}

TEST_F(PlcSimulator, a_command_meant_for_another_boot_is_refused) {
    ASSERT_EQ(command(5, Command::arm, 0, 0xB008), Exception::none);
    EXPECT_THAT(station.commands, IsEmpty());
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 2, 3, 7));
    ASSERT_EQ(command(6, Command::arm, 0, 0xB007), Exception::none);
    EXPECT_EQ(station.commands.size(), 1U);
}

TEST_F(PlcSimulator, only_a_whole_command_is_a_command) {
    EXPECT_EQ(write(8002, {0, 1}), Exception::illegal_value);
    EXPECT_EQ(write(8003, {1, 0, 2}), Exception::illegal_value) << "half a token";
    EXPECT_EQ(write(8004, {0, 2}), Exception::illegal_value) << "no token";
    EXPECT_EQ(write(8002, {0, 1, 0, 2, 0}), Exception::illegal_value) << "half an argument";
    EXPECT_EQ(write(8002, {0, 0, 0, 2}), Exception::illegal_value) << "token 0";
    EXPECT_EQ(write(8002, {0, 1, 0, 2, 0, 0, 0, 0, 0}), Exception::illegal_value) << "half a name";
    EXPECT_EQ(write(8002, Words(19)), Exception::illegal_address) << "beyond the command";
    EXPECT_EQ(write(8000, {6, 18, 0, 1, 0, 2}), Exception::illegal_address) << "with the header";
    EXPECT_THAT(station.commands, IsEmpty());
    EXPECT_EQ(write(8002, {0, 1, 0, 2}), Exception::none) << "arguments may be left out";
    EXPECT_EQ(station.commands.size(), 1U);
}

// An argument that is left out is not recipe 0.
TEST_F(PlcSimulator, a_recipe_is_taken_only_with_the_argument_that_names_it) {
    for (const Command code : {Command::use_recipe, Command::commit_recipe}) {
        const auto token = static_cast<std::uint16_t>(code);
        ASSERT_EQ(write(8002, {0, token, 0, token}), Exception::none);
        EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, token, token, 3, 4)) << "bad_argument";
    }
    EXPECT_THAT(station.commands, IsEmpty());
    ASSERT_EQ(write(8002, {0, 1, 0, 23, 0, 0}), Exception::none) << "argument2 may be left out";
    EXPECT_EQ(station.commands.size(), 1U) << "recipe 0, as it was written";
}

TEST_F(PlcSimulator, while_a_command_is_executing_only_stopping_is_accepted) {
    station.answer = {CommandState::executing, CommandError::none, 0};
    ASSERT_EQ(command(5, Command::self_test), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 22, 1, 0));
    EXPECT_EQ(command(6, Command::arm), Exception::busy);
    EXPECT_EQ(command(5, Command::self_test), Exception::none) << "a repeat asks how it is going";
    station.answer = {};
    EXPECT_EQ(command(7, Command::stop), Exception::none);
    plc_interface.finish(station.commands[0], {CommandState::completed, CommandError::none, 42});
    plc_interface.finish(station.commands[0], {CommandState::failed, CommandError::failed, 43});  // it is over
    plc_interface.finish({.token = 99}, {});
    EXPECT_EQ(command(5, Command::self_test), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 5, 22, 2, 0));
    EXPECT_EQ(read32(8027), 42U);
    EXPECT_EQ(command(6, Command::arm), Exception::none) << "refused as busy was not remembered";
    EXPECT_EQ(station.commands.size(), 3U);
}

// A sender that repeats until it sees its reply, over a network that loses, repeats and reorders.
TEST_F(PlcSimulator, ten_thousand_commands_over_a_bad_network_are_executed_exactly_once) {
    std::mt19937 random(8);
    std::deque<std::uint32_t> under_way;
    std::uint32_t disturbed = 0;
    for (std::uint32_t token = 1; token <= 10'000; ++token) {
        for (bool acknowledged = false; !acknowledged;) {
            for (auto copies = random() % 3; copies > 0; --copies) under_way.push_back(token);  // lost, once, twice
            while (!under_way.empty() && random() % 4 != 0) {
                const std::size_t pick = random() % under_way.size();  // late and out of order
                disturbed += pick > 0 ? 1 : 0;
                ASSERT_EQ(command(under_way[pick], Command::start_single), Exception::none);
                under_way.erase(under_way.begin() + static_cast<std::ptrdiff_t>(pick));
                acknowledged = acknowledged || read32(8022) == token;
            }
            while (under_way.size() > 100) under_way.pop_front();
        }
    }
    std::map<std::uint32_t, int> executed;
    for (const CommandRequest& request : station.commands) ++executed[request.token];
    EXPECT_EQ(executed.size(), 10'000U);
    EXPECT_EQ(station.commands.size(), 10'000U);
    EXPECT_GT(disturbed, 1000U);
}

TEST_F(PlcSimulator, the_heartbeat_is_missed_after_the_timeout_and_reported_once) {
    clock.at += 10s;
    plc_interface.check_plc_heartbeat();
    EXPECT_EQ(station.lost, 0) << "a PLC that was never there cannot be lost";
    EXPECT_EQ(read(105, 1)[0], 0xFFFF);
    ASSERT_EQ(write(8102, {1}), Exception::none);
    clock.at += 400ms;
    EXPECT_EQ(read(105, 1)[0], 400);
    plc_interface.check_plc_heartbeat();
    ASSERT_EQ(write(8102, {1}), Exception::none) << "the same value is no beat";
    clock.at += 101ms;
    plc_interface.check_plc_heartbeat();
    plc_interface.check_plc_heartbeat();
    EXPECT_EQ(station.lost, 1);
    EXPECT_EQ(read(103, 1)[0] & 0x80, 0x80);
    ASSERT_EQ(write(8102, {2}), Exception::none);
    EXPECT_EQ(station.back, 1);
    EXPECT_EQ(read(103, 1)[0] & 0x80, 0);
    EXPECT_THAT(read(8105, 2), ElementsAre(1, 500));
}

TEST_F(PlcSimulator, a_coil_can_carry_the_heartbeat) {
    const bool on = true;
    ASSERT_EQ(image.write_bits({}, 80, std::span(&on, 1)), Exception::none);
    EXPECT_EQ(read(8102, 1)[0], 1);
    EXPECT_EQ(image.write_bits({}, 79, std::span(&on, 1)), Exception::illegal_address);
}

TEST_F(PlcSimulator, results_are_acknowledged_forwards_and_only_when_they_exist) {
    publish_results(1, 10);
    ASSERT_EQ(write(8103, {0, 4}), Exception::none);
    ASSERT_EQ(write(8103, {0, 4}), Exception::none) << "repeating it is harmless";
    EXPECT_EQ(write(8103, {0, 3}), Exception::illegal_value);
    EXPECT_EQ(write(8103, {0, 11}), Exception::illegal_value) << "a PLC that remembers another boot notices";
    EXPECT_EQ(write(8103, {0}), Exception::illegal_value);
    ASSERT_EQ(write(8102, {9, 0, 10}), Exception::none) << "together with the heartbeat";
    EXPECT_THAT(station.acknowledged, ElementsAre(4, 10));
    EXPECT_EQ(read32(8109), 0U);
}

TEST_F(PlcSimulator, results_that_are_not_stored_yet_are_not_taken_and_the_heartbeat_counts_all_the_same) {
    publish_results(1, 10);
    ASSERT_EQ(write(8102, {8, 0, 4}), Exception::none);
    for (const Exception refusal : {Exception::busy, Exception::device_failure}) {
        station.taken = refusal;
        EXPECT_EQ(write(8102, {static_cast<std::uint16_t>(refusal), 0, 10}), refusal);
        EXPECT_EQ(read32(8103), 4U);
        EXPECT_EQ(read(8102, 1)[0], static_cast<std::uint16_t>(refusal));
    }
    station.taken = Exception::none;
    EXPECT_EQ(write(8103, {0, 10}), Exception::none);
    EXPECT_EQ(read32(8103), 10U);
    EXPECT_THAT(station.acknowledged, ElementsAre(4, 10));
}

TEST_F(PlcSimulator, results_lost_before_they_were_acknowledged_are_counted_and_shown) {
    publish_results(1, 300);
    EXPECT_EQ(read32(8107), 0U) << "nobody acknowledges: nobody is overrun";
    ASSERT_EQ(write(8103, {0, 300}), Exception::none);
    publish_results(301, 556);
    EXPECT_EQ(read32(8107), 0U) << "256 are still there";
    EXPECT_EQ(read(103, 1)[0] & 0x40, 0);
    publish_results(557, 560);
    EXPECT_EQ(read32(8107), 4U);
    EXPECT_EQ(read(103, 1)[0] & 0x40, 0x40);
    ASSERT_EQ(write(8103, {0x0, 560}), Exception::none);
    publish_results(561, 800);
    EXPECT_EQ(read32(8107), 4U);
}

// A PLC that acknowledges for the first time may begin with any result that is still there, or with none.
TEST_F(PlcSimulator, results_overwritten_before_the_first_acknowledgement_do_not_count) {
    publish_results(1, 1000);
    ASSERT_EQ(write(8103, {0, 10}), Exception::none);
    publish_results(1001, 1003);
    EXPECT_EQ(read32(8107), 3U);
}

TEST_F(PlcSimulator, every_result_overwritten_after_the_first_acknowledgement_counts) {
    publish_results(1, 100);
    ASSERT_EQ(write(8103, {0, 0}), Exception::none);
    publish_results(101, 256);
    EXPECT_EQ(read32(8107), 0U);
    publish_results(257, 257);
    EXPECT_EQ(read32(8107), 1U);
}

TEST_F(PlcSimulator, a_recipe_is_staged_and_committed_by_its_checksum) {
    ASSERT_EQ(write(8202, {7, 1500, 800, 600, 3, 0xFFFE, 100, 700}), Exception::none);
    const std::uint32_t crc = read32(8210);
    ASSERT_EQ(command(1, Command::commit_recipe, crc ^ 1), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 1, 20, 3, 5));
    ASSERT_EQ(command(3, Command::commit_recipe, crc, 0, 5), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 3, 20, 3, 4)) << "no other argument";
    EXPECT_THAT(station.commands, IsEmpty());
    ASSERT_EQ(command(2, Command::commit_recipe, crc), Exception::none);
    ASSERT_EQ(station.commands.size(), 1U);
    EXPECT_EQ(station.commands[0].code, static_cast<std::uint16_t>(Command::commit_recipe));
    EXPECT_EQ(plc_interface.view().staged, (StagedRecipe{7, 1500, 800, 600, 3, -2, 100, 700}));
    EXPECT_THAT(read(8202, 8), ElementsAre(7, 1500, 800, 600, 3, 0xFFFE, 100, 700)) << "reads back as written";
}

TEST_F(PlcSimulator, the_checksum_is_the_ordinary_crc32_of_the_bytes_as_they_travel) {
    // zlib.crc32(bytes.fromhex("000105dc0320025800030001006402bc"))
    ASSERT_EQ(write(8202, {1, 1500, 800, 600, 3, 1, 100, 700}), Exception::none);
    EXPECT_EQ(read32(8210), 0x6D73F6CDU);
}

TEST_F(PlcSimulator, no_recipe_is_committed_while_the_station_executes) {
    Snapshot snapshot;
    snapshot.state = State::continuous_execution;
    image.publish(snapshot);
    ASSERT_EQ(command(1, Command::commit_recipe, read32(8210)), Exception::none);
    EXPECT_THAT(reply_of(read(8020, 40)), ElementsAre(0, 1, 20, 3, 2));
    EXPECT_THAT(station.commands, IsEmpty());
}

TEST_F(PlcSimulator, nothing_but_the_rows_marked_writable_can_be_written) {
    int writable = 0;
    for (int address = 0; address < 0x10000; ++address) {
        const Register* row = nullptr;
        for (const Block& block : register_blocks()) {
            for (const Register& r : block.registers) {
                if (address >= r.address && address < r.address + r.words) row = &r;
            }
        }
        const auto answer = write(static_cast<std::uint16_t>(address), {0});
        if (row != nullptr && row->access == RegisterAccess::read_write) {
            EXPECT_NE(answer, Exception::illegal_address) << address;
            ++writable;
        } else {
            EXPECT_EQ(answer, Exception::illegal_address) << address;
        }
    }
    EXPECT_EQ(writable, 18 + 3 + 8);
    EXPECT_THAT(station.commands, IsEmpty());
}

TEST_F(PlcSimulator, a_value_that_means_not_available_cannot_be_written) {
    for (const std::uint16_t address : std::vector<std::uint16_t>{8202, 8206, 8208, 8209})
        EXPECT_EQ(write(address, {0xFFFF}), Exception::illegal_value) << address;
    EXPECT_EQ(write(8207, {0x8000}), Exception::illegal_value);
    EXPECT_EQ(write(8203, {0xFFFF, 0xFFFF, 0xFFFF}), Exception::none) << "a limit may stay as it is";
    EXPECT_THAT(read(8203, 3), ElementsAre(0xFFFF, 0xFFFF, 0xFFFF));
    EXPECT_EQ(write(8102, {0xFFFF}), Exception::none) << "a heartbeat is any number";
}

TEST(RegisterImageWithoutDesk, takes_no_writes_and_shows_no_plc) {
    RegisterServerModel image(StationIdentity{});
    const std::uint16_t one = 1;
    EXPECT_EQ(image.write_registers({}, 8102, std::span(&one, 1)), Exception::illegal_address);
    std::array<std::uint16_t, 12> plc{};
    ASSERT_EQ(image.read_registers(8100, plc), Exception::none);
    EXPECT_THAT(plc, ElementsAre(8, 98, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF));
}

}  // namespace
}  // namespace hord::firmware
