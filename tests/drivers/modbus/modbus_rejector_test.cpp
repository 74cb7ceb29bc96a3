// The rejector driver with a misbehaving coil module, over loopback, in real time.
#include <algorithm>

#include "hal_sim/cell/cell.h"
#include "tests/drivers/modbus/rejector_bench.h"
#include "tests/support/answering_server.h"

namespace hord::drivers {
namespace {

using Rejector = RejectorBench;

TEST_F(Rejector, a_module_absent_at_start_is_named_commands_fail_and_it_is_found_when_it_comes) {
    module_->power_off();
    start();
    ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
    EXPECT_FALSE(ear_.up);
    EXPECT_THAT(ear_.why_down.what, HasSubstr("127.0.0.1:" + std::to_string(options_.address.port)));
    EXPECT_FALSE(ear_.why_down.cure.empty());
    EXPECT_EQ(reject(1), Outcome::failed);
    EXPECT_EQ(ear_.changes, 1);  // reported once, for any number of attempts
    ASSERT_TRUE(module_->power_on());
    expect_recovered();
}

TEST_F(Rejector, a_module_that_is_silent_from_the_start_is_down_and_does_not_hold_up_anything) {
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    start();
    ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
    EXPECT_FALSE(ear_.up);
    EXPECT_THAT(ear_.why_down.message(), AllOf(HasSubstr("no answer within 400 ms"), HasSubstr("rejector.unit")));
    EXPECT_EQ(reject(1), Outcome::failed);
    module_->misbehave(ModuleFault::none);
    expect_recovered();
}

TEST_F(Rejector, silence_in_the_middle_of_a_run_fails_the_command_and_drops_the_link_until_it_answers) {
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::confirmed);
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    EXPECT_EQ(reject(2), Outcome::failed);
    EXPECT_TRUE(run_until([&] { return !ear_.up; }));
    EXPECT_EQ(reject(3), Outcome::failed);
    module_->misbehave(ModuleFault::none);
    expect_recovered();
}

TEST_F(Rejector, silence_is_noticed_without_any_command) {
    start_and_wait();
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    EXPECT_TRUE(run_until([&] { return !ear_.up; }));
    EXPECT_THAT(ear_.why_down.what, HasSubstr("coil "));
}

TEST_F(Rejector, a_late_answer_costs_its_own_command_at_most_and_never_acts_twice) {
    start_and_wait();
    module_->misbehave(ModuleFault::late, 1, 3 * kTimeout);
    EXPECT_EQ(reject(1), Outcome::failed);  // it acted, but the answer was too late
    EXPECT_EQ(times_on(kEjector), 1);
    ASSERT_TRUE(run_until([&] { return ear_.up && module_->connections() >= 2 && !module_->coil(kEjector); }));
    for (std::uint32_t part = 2; part <= 6; ++part) {
        ASSERT_TRUE(run_until([&] { return ear_.up; }));
        EXPECT_EQ(reject(part), Outcome::confirmed) << part;
    }
    ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    // The windows of parts 2 to 6 overlap: the valve stays open.
    EXPECT_LE(times_on(kEjector), 6);
}

// The report has the time of the acknowledgement, when the output had moved, also if reading back takes long.
TEST_F(Rejector, a_rejection_is_told_with_the_time_at_which_its_write_was_acknowledged) {
    options_.response_timeout = 900ms;
    options_.check_every = 60s;
    start_and_wait();
    constexpr hal::Duration kSlow = 100ms;
    module_->misbehave_at_reads(ModuleFault::late, 1, kSlow);
    ASSERT_EQ(reject(1), Outcome::confirmed);
    EXPECT_EQ(module_->misbehaved(), 1);
    const auto history = module_->history();
    const auto moved = std::ranges::find_if(history, [](const auto& move) { return move.coil == kEjector && move.on; });
    ASSERT_NE(moved, history.end());
    EXPECT_GE(ear_.reports.back().at, moved->at);
    EXPECT_LE(ear_.reports.back().at + kSlow, loop_->now());
}

TEST_F(Rejector, a_reading_back_that_has_no_time_left_says_how_long_the_write_took) {
    options_.check_every = 60s;
    start_and_wait();
    module_->misbehave(ModuleFault::silent, 0);
    module_->misbehave_at_reads(ModuleFault::silent, 1);
    EXPECT_EQ(reject(1), Outcome::failed);
    ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); }));
    EXPECT_THAT(ear_.losses[0],
                AllOf(HasSubstr("cannot be read back: no answer within 400 ms for the write ("),
                      HasSubstr(" ms) and its reading back together")));
}

TEST_F(Rejector, an_answer_that_drips_in_byte_by_byte_is_not_waited_for) {
    start_and_wait();
    module_->misbehave(ModuleFault::drip, 1, kTimeout / 2);
    const hal::TimePoint asked = loop_->now();
    EXPECT_EQ(reject(1), Outcome::failed);
    EXPECT_LT(ear_.reports.back().at - asked, 12 * kTimeout / 2);  // the whole answer would take that long
    expect_recovered();
}

TEST_F(Rejector, a_refusal_fails_the_command_and_keeps_the_link) {
    start_and_wait();
    module_->misbehave(ModuleFault::exception, 1);
    EXPECT_EQ(reject(1), Outcome::failed);
    ASSERT_EQ(ear_.failures.size(), 1U);
    EXPECT_THAT(ear_.failures[0].message(), HasSubstr("the module's own fault display"));
    EXPECT_EQ(reject(2), Outcome::confirmed);
    EXPECT_EQ(ear_.failures.size(), 1U);
    EXPECT_EQ(module_->connections(), 1);
    EXPECT_EQ(ear_.changes, 1);
}

TEST_F(Rejector, a_refused_permit_drops_the_link_with_what_the_module_said) {
    start_and_wait();
    module_->misbehave(ModuleFault::exception, 1);
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return ear_.changes >= 3 && ear_.up; }));
    EXPECT_THAT(ear_.losses[0], AllOf(HasSubstr("coil 1 of the rejector module"), HasSubstr("cannot be written")));
    EXPECT_FALSE(module_->coil(kPermit)) << "it is set when it is said again";
}

TEST_F(Rejector, what_is_asked_for_is_done_at_once_and_not_at_the_next_check) {
    options_.check_every = 20s;
    start_and_wait();
    const hal::TimePoint from = loop_->now();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    EXPECT_EQ(reject(1, 60s), Outcome::confirmed);
    rejector_->stop();  // in the middle of the pulse
    EXPECT_LT(loop_->now() - from, 20s);
}

TEST_F(Rejector, a_coil_that_does_not_read_back_as_written_is_not_confirmed) {
    start_and_wait();
    module_->misbehave(ModuleFault::stuck, 1);
    EXPECT_EQ(reject(1), Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 0);
    const std::string at = "127.0.0.1:" + std::to_string(options_.address.port);
    ASSERT_EQ(ear_.failures.size(), 1U);
    EXPECT_EQ(ear_.failures[0].what,
              "coil 0 of the rejector module at " + at + " answered, but reads back 0 where 1 was written");
    EXPECT_THAT(ear_.failures[0].cure, AllOf(HasSubstr("rejector.profile"), HasSubstr("devices --module " + at)));
}

TEST_F(Rejector, what_answers_and_is_not_the_module_is_told_as_that_and_not_as_silence) {
    const auto refusal = [](char code) {
        return [code](const std::string& sent) {
            if (sent.size() < 8) return std::string();
            const char function = static_cast<char>(static_cast<unsigned char>(sent[7]) | 0x80U);
            return sent.substr(0, 2) + std::string("\0\0\0\3", 4) + sent[6] + function + code;
        };
    };
    struct Case {
        std::function<std::string(const std::string&)> answer;
        const char *what, *cure;
    };
    const Case cases[] = {
        {[](const std::string&) { return std::string("HTTP/1.1 400 Bad Request\r\n\r\n"); },
         "the answer is none of Modbus", "is the rejector's module really at 127.0.0.1:"},
        {[](const std::string&) { return std::string(); }, "Connection reset", "really at 127.0.0.1:"},
        {refusal(1), "no such output", "rejector.profile"},
        {refusal(2), "no such output", "hordctl devices --module"},
        {refusal(10), "a gateway answers", "rejector.unit"},
        {refusal(11), "a gateway answers", "behind the gateway"},
        {refusal(12), "Invalid exception code (the answer is none of Modbus)", "really at"},
        // The request itself is the answer to a write: of another unit, and of another coil.
        {[](std::string sent) { return sent.replace(6, 1, "\7"); }, "unit 7 answers, not unit 1", "rejector.unit"},
        {[](std::string sent) { return sent.replace(9, 1, "\5"); }, "the answer acknowledges address 5, not 0",
         "rejector.unit"},
        {[](std::string sent) { return sent.replace(1, 1, "\x77"); }, "the answer is none of Modbus", "really at"},
    };
    for (const Case& one : cases) {
        const test::AnsweringServer server(one.answer);
        options_.address.port = server.port();
        ear_ = {};
        start();
        ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
        EXPECT_THAT(ear_.why_down.what, HasSubstr(one.what));
        EXPECT_THAT(ear_.why_down.cure, HasSubstr(one.cure));
        rejector_->stop();
        rejector_.reset();
    }
}

TEST_F(Rejector, a_command_that_comes_again_is_reported_again_and_carried_out_once) {
    start_and_wait();
    const hal::RejectCommand command{7, loop_->now(), kWindow};
    ASSERT_TRUE(rejector_->reject(command));
    ASSERT_TRUE(rejector_->reject(command)) << "while it is under way";
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 2; }));
    ASSERT_TRUE(rejector_->reject(command)) << "after its report";
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 3; }));
    for (const auto& report : ear_.reports) {
        EXPECT_EQ(report.part, 7U);
        EXPECT_EQ(report.outcome, Outcome::confirmed);
        EXPECT_EQ(report.at, ear_.reports.front().at);
    }
    EXPECT_EQ(times_on(kEjector), 1);
}

TEST_F(Rejector, takes_32_commands_and_what_waits_when_it_stops_has_failed) {
    start_and_wait();
    const hal::TimePoint later = loop_->now() + 3600s;
    for (std::uint32_t part = 1; part <= 32; ++part) ASSERT_TRUE(rejector_->reject({part, later, kWindow})) << part;
    const auto refused = rejector_->reject({33, later, kWindow});
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::busy);
    EXPECT_TRUE(ear_.reports.empty());
    rejector_->stop();
    ASSERT_EQ(ear_.reports.size(), 32U);
    for (const auto& report : ear_.reports) EXPECT_EQ(report.outcome, Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 0);
}

TEST_F(Rejector, a_connection_closed_in_the_middle_fails_the_command_and_is_made_anew) {
    start_and_wait();
    module_->misbehave(ModuleFault::close, 1);
    EXPECT_EQ(reject(1), Outcome::failed);
    expect_recovered();
    EXPECT_GE(module_->connections(), 2);
}

TEST_F(Rejector, a_module_that_restarts_is_noticed_and_the_permit_stays_down_until_said_again) {
    start_and_wait();
    rejector_->set_run_permit(true);
    ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    module_->power_off();
    ASSERT_TRUE(module_->power_on());
    ASSERT_TRUE(run_until([&] { return ear_.changes >= 3 && ear_.up; }));
    EXPECT_FALSE(module_->coil(kPermit));
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_FALSE(module_->coil(kPermit));
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
}

TEST_F(Rejector, a_pulse_left_on_by_a_lost_link_is_taken_back_first_thing) {
    start_and_wait();
    ASSERT_TRUE(rejector_->reject({1, loop_->now(), 3600s}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    module_->misbehave(ModuleFault::close, 1);
    rejector_->set_run_permit(true);  // the module closes the connection on this write
    EXPECT_TRUE(run_until([&] { return ear_.changes >= 3 && ear_.up; }));
    EXPECT_FALSE(module_->coil(kEjector));
}

TEST_F(Rejector, energise_to_pass_rests_at_1_acts_at_0_and_is_left_at_0) {
    options_.energise_to_pass = true;
    start_and_wait();
    EXPECT_TRUE(module_->coil(kEjector));
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_FALSE(module_->coil(kEjector));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));  // the pulse is over
    rejector_->stop();
    EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector); }));  // as on lost communication: nothing passes
}

TEST_F(Rejector, a_request_that_is_lost_while_it_stops_is_made_again_and_the_permit_falls) {
    for (const auto fault : {ModuleFault::silent, ModuleFault::close}) {
        start_and_wait();
        rejector_->set_run_permit(true);
        ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
        module_->misbehave(fault, 1);
        rejector_->stop();
        EXPECT_FALSE(module_->coil(kPermit));
        ear_.up = false;
    }
}

TEST_F(Rejector, what_is_refused_while_it_stops_is_asked_for_again_and_the_permit_falls) {
    for (const int refusals : {1, 2, 3}) {
        start_and_wait();
        rejector_->set_run_permit(true);
        ASSERT_TRUE(run_until([&] { return module_->coil(kPermit); }));
        module_->misbehave(ModuleFault::exception, refusals);
        rejector_->stop();
        EXPECT_FALSE(module_->coil(kPermit)) << refusals;
        ear_.up = false;
    }
}

TEST_F(Rejector, impossible_options_are_all_named_and_nothing_starts) {
    options_.address.port = 0;
    options_.address.host.clear();
    options_.permit_coil = options_.ejector_coil;
    options_.response_timeout = 0ms;
    rejector_.emplace(*loop_, options_);
    const auto done = rejector_->start(ear_);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(done.error().what,
                AllOf(HasSubstr("port"), HasSubstr("host"), HasSubstr("permit_coil"), HasSubstr("response_timeout")));
    EXPECT_EQ(module_->connections(), 0);
}

// The first value beyond each limit is refused by name, and the last within it is taken.
TEST_F(Rejector, options_are_taken_up_to_their_limits) {
    using Options = ModbusRejectorOptions;
    const SerialSettings line{.device = "/dev/no-such-line", .baud = 1200, .parity = 'N', .rs485 = false};
    struct Limit {
        const char* named;
        std::function<void(Options&, int beyond)> set;  // beyond: 0 within the limit, 1 outside
    };
    const Limit limits[] = {
        {"port", [](Options& o, int k) { o.address.port = 65535 + k; }},
        {"port", [](Options& o, int k) { o.address.port = 1 - k; }},
        {"unit", [](Options& o, int k) { o.address.unit = 1 - k; }},
        {"unit", [](Options& o, int k) { o.address.unit = 247 + k; }},
        {"unit", [](Options& o, int k) { o.address.unit = 255 - k; }},
        {"unit", [](Options& o, int k) { o.address.unit = 255 + k; }},
        {"host", [](Options& o, int k) { o.address.host = k == 0 ? "localhost" : ""; }},
        {"device", [&](Options& o, int k) { (o.address.serial = line)->device = k == 0 ? "x" : ""; }},
        {"baud", [&](Options& o, int k) { (o.address.serial = line)->baud = 1200 - k; }},
        {"unit", [&](Options& o, int k) { o.address.serial = line, o.address.unit = 1 - k; }},
        {"unit", [&](Options& o, int k) { o.address.serial = line, o.address.unit = 247 + k; }},
        {"ejector_coil", [](Options& o, int k) { o.ejector_coil = 65535 + k; }},
        {"ejector_coil", [](Options& o, int k) { o.permit_coil = 1, o.ejector_coil = 0 - k; }},
        {"permit_coil", [](Options& o, int k) { o.permit_coil = 65535 + k; }},
        {"permit_coil", [](Options& o, int k) { o.permit_coil = -1 - k; }},
        {"permit_coil", [](Options& o, int k) { o.permit_coil = o.ejector_coil + 1 - k; }},
        {"first output",
         [](Options& o, int k) { o.ejector_coil = o.map.first_output = 9, o.permit_coil = 9 + 1 - 2 * k; }},
        {"first output",
         [](Options& o, int k) { o.permit_coil = o.map.first_output = 9, o.ejector_coil = 9 + 1 - 2 * k; }},
        {"first output", [](Options& o, int k) { o.ejector_coil = 0, o.permit_coil = 5, o.map.first_output = k; }},
        {"first output", [](Options& o, int k) { o.permit_coil = 0, o.ejector_coil = 5, o.map.first_output = k; }},
        {"permit_coil starts the pulses of output 0",
         [](Options& o, int k) { o.permit_coil = 15 + k, o.map.pulse_coil_offset = 16; }},
        {"ejector_coil is this module's alarm coil",
         [](Options& o, int k) { o.ejector_coil = 4143 + k, o.map.alarm_coil = 4144; }},
        {"response_timeout", [](Options& o, int k) { o.response_timeout = 5ms - k * 1ns; }},
        {"response_timeout", [](Options& o, int k) { o.response_timeout = 1s + k * 1ns; }},
        {"reconnect_every", [](Options& o, int k) { o.reconnect_every = 1ns - k * 1ns; }},
        {"check_every", [](Options& o, int k) { o.check_every = 1ns - k * 1ns; }},
        {"confirm_every", [](Options& o, int k) { o.confirm_every = 1ns - k * 1ns; }},
        {"module_pulse", [](Options& o, int k) { o.module_pulse = 10ms, o.map.pulse_coil_offset = 0 - k; }},
        {"energise_to_pass",
         [](Options& o, int k) { o.module_pulse = 10ms, o.map.pulse_coil_offset = 16, o.energise_to_pass = k != 0; }},
        {"watchdog must be 0",
         [](Options& o, int k) {
             o.watchdog = 3 * o.response_timeout;
             o.map.watchdog_time_register = o.map.watchdog_trigger_register = 0;
             o.map.watchdog_stop_register = 0 - k;
         }},
        {"watchdog must be 0",
         [](Options& o, int k) {
             o.watchdog = 3 * o.response_timeout;
             o.map.watchdog_time_register = o.map.watchdog_stop_register = 0;
             o.map.watchdog_trigger_register = 0 - k;
         }},
        {"watchdog must be 0",
         [](Options& o, int k) {
             o.watchdog = 3 * o.response_timeout;
             o.map.watchdog_trigger_register = o.map.watchdog_stop_register = 0;
             o.map.watchdog_time_register = 0 - k;
         }},
        {"three response_timeouts", [](Options& o, int k) {
             o.map.watchdog_time_register = o.map.watchdog_trigger_register = o.map.watchdog_stop_register = 0;
             o.watchdog = 3 * o.response_timeout - k * 1ns;
         }}};
    module_.reset();  // nobody is to answer
    for (const Limit& limit : limits) {
        SCOPED_TRACE(&limit - limits);
        for (const int beyond : {0, 1}) {
            Options options = options_;
            limit.set(options, beyond);
            ModbusRejector one(*loop_, options);
            const auto done = one.start(ear_);
            ASSERT_EQ(done.has_value(), beyond == 0) << (done ? limit.named : done.error().what);
            if (!done) {
                EXPECT_THAT(done.error().what, HasSubstr(limit.named));
            }
            one.stop();
        }
    }
}

TEST_F(Rejector, a_taken_port_is_named_by_the_module) {
    const auto second = test::ModbusModule::open(*loop_, {.port = module_->port()});
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_THAT(second.error().what, HasSubstr(std::to_string(module_->port())));
}

// The simulated cell in real time, ejecting over Modbus: the module's coil moves the simulated ejector.
TEST_F(Rejector, the_module_ejects_the_part_that_is_really_there) {
    sim::CellOptions cell_options;
    cell_options.schedule.parts = 1;
    cell_options.geometry.ejector_reach_mm = 50;  // 200 ms of belt: real time on a busy machine
    cell_options.geometry.exit_mm = 600;
    sim::TokenFrames frames({27, 18, 8});
    auto cell = std::move(*sim::SimulatedCell::make(*loop_, frames, cell_options));
    module_->on_coil([&](int coil, bool on, hal::TimePoint at) {
        if (coil == kEjector) loop_->post([&cell, on, at] { cell->world().set_ejector(on, at); });
    });
    start_and_wait();
    cell->start();
    const hal::TimePoint centred =
        loop_->now() + cell_options.travel(cell_options.schedule.first_mm) + cell_options.ejector_delay();
    ASSERT_TRUE(rejector_->reject({1, centred - 50ms, 100ms}));
    EXPECT_TRUE(run_until([&] { return cell->world().totals().ejected_good == 1; }));
    EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    rejector_->stop();
    module_->power_off();
}

}  // namespace
}  // namespace hord::drivers
