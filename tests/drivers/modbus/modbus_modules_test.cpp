// The rejector driver with the features of particular modules: read-back address, watchdog, pulses timed by the module.
// The simulated modules follow the manuals, not the profiles.
#include <algorithm>

#include "drivers/modbus/coil_link.h"
#include "firmware/config/module_profiles.h"
#include "tests/drivers/modbus/rejector_bench.h"

namespace hord::drivers {
namespace {

ModuleMap map_of(std::string_view name) {
    for (const auto& profile : firmware::module_profiles()) {
        if (profile.name == name) return profile.map;
    }
    throw std::runtime_error("no such profile");
}

class Module : public RejectorBench {
  protected:
    void play(const test::ModbusModuleOptions& module, std::string_view profile) {
        connect_to(module);
        options_.map = map_of(profile);
    }
};

TEST_F(Module, of_wago_reads_outputs_back_where_they_are) {
    play({.kind = test::ModuleKind::wago}, "wago-750");
    start_and_wait();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_EQ(ear_.changes, 1);
}

TEST_F(Module, of_wago_with_the_plain_profile_confirms_nothing) {
    play({.kind = test::ModuleKind::wago}, "plain-coils");
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::failed) << "its inputs were read for its outputs";
    ASSERT_EQ(ear_.failures.size(), 1U);
    EXPECT_THAT(ear_.failures[0].cure, HasSubstr("rejector.profile"));
}

TEST_F(Module, of_wago_has_its_watchdog_started_and_kept_alive_over_tcp_and_serial) {
    for (const bool serial : {false, true}) {
        play({.kind = test::ModuleKind::wago, .serial = serial, .unit = 1}, "wago-750");
        options_.watchdog = 1500ms;
        ear_ = {};
        start_and_wait();
        EXPECT_TRUE(run_until([&] { return module_->watchdog_triggers() >= 3; }));
        EXPECT_FALSE(module_->watchdog_expired());
        EXPECT_EQ(ear_.changes, 1);
        for (int again = 0; again < 2; ++again) {  // for both values that an earlier station can leave in the trigger
            rejector_->stop();
            const int before = module_->watchdog_triggers();
            ear_ = {};
            start_and_wait();
            EXPECT_TRUE(run_until([&] { return module_->watchdog_triggers() > before; }));
        }
        rejector_->stop();
        rejector_.reset();
    }
}

TEST_F(Module, of_wago_that_no_longer_hears_the_station_drops_its_outputs_and_works_again_afterwards) {
    play({.kind = test::ModuleKind::wago}, "wago-750");
    options_.watchdog = 1500ms;
    start_and_wait();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(kPermit); }));
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    EXPECT_TRUE(run_until([&] { return module_->watchdog_expired(); }));
    EXPECT_FALSE(module_->coil(kPermit));
    module_->misbehave(ModuleFault::none);
    expect_recovered();
    EXPECT_FALSE(module_->watchdog_expired());
}

// The driver's thread was delayed, so the module's watchdog dropped the permit that the station had set.
TEST_F(Module, whose_permit_fell_by_itself_is_noticed) {
    start_and_wait();
    CoilLink other(*loop_, options_.address, 10s);
    ASSERT_TRUE(other.connect());
    // While the driver still reads back what it wrote, the change is another error: the permit is set once more then.
    const auto noticed = [&] {
        const auto fell = [](const std::string& why) { return why.find("coil 1 is 0") != std::string::npos; };
        if (std::ranges::any_of(ear_.losses, fell)) return ear_.up;
        if (module_->coil(kPermit)) {
            EXPECT_TRUE(other.write(kPermit, false));
        } else if (ear_.up) {
            rejector_->set_run_permit(true);
        }
        return false;
    };
    EXPECT_TRUE(run_until(noticed));
}

TEST_F(Module, of_moxa_times_the_pulse_itself) {
    play({.kind = test::ModuleKind::moxa, .pulse = 40ms}, "moxa-iologik");
    options_.module_pulse = 40ms;
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::confirmed);
    ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    const auto moves = module_->history();
    ASSERT_EQ(moves.size(), 2U);
    EXPECT_EQ(moves[1].at - moves[0].at, 40ms);
    // The pulse ends also without a driver.
    EXPECT_EQ(reject(2), Outcome::confirmed);
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    EXPECT_TRUE(run_until([&] { return !module_->coil(kEjector) && !ear_.up; }));
    EXPECT_EQ(times_on(kEjector), 2);
}

TEST_F(Module, of_moxa_has_its_pulse_coil_checked_between_pulses_alone) {
    play({.kind = test::ModuleKind::moxa, .pulse = 1s}, "moxa-iologik");
    options_.module_pulse = 1s;
    start_and_wait();
    EXPECT_EQ(reject(1, 1s + kWindow), Outcome::confirmed);
    ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    EXPECT_THAT(ear_.losses, testing::IsEmpty());
    CoilLink other(*loop_, options_.address, 10s);
    ASSERT_TRUE(other.connect());
    const auto noticed = [&] {
        if (ear_.losses.empty() && !module_->coil(kEjector)) {
            EXPECT_TRUE(other.write(16 + kEjector, true));
        }
        return !ear_.losses.empty();
    };
    EXPECT_TRUE(run_until(noticed));
    EXPECT_THAT(ear_.losses[0], HasSubstr("lost its outputs: coil 16 is 1 ("));
}

TEST_F(Module, whose_pulse_does_not_fit_into_the_window_does_not_act) {
    play({.kind = test::ModuleKind::moxa, .pulse = 100ms}, "moxa-iologik");
    options_.module_pulse = 100ms;
    start_and_wait();
    EXPECT_EQ(reject(1, 90ms), Outcome::late);
    EXPECT_EQ(times_on(kEjector), 0);
}

TEST_F(Module, whose_pulse_was_started_by_a_request_with_a_lost_answer_is_not_pulsed_again) {
    play({.kind = test::ModuleKind::moxa, .pulse = 30ms}, "moxa-iologik");
    options_.module_pulse = 30ms;
    start_and_wait();
    module_->misbehave(ModuleFault::late, 1, 2 * kTimeout);
    EXPECT_EQ(reject(1), Outcome::failed);
    expect_recovered();
    EXPECT_EQ(times_on(kEjector), 2);  // part 1 and that of the recovery
}

TEST_F(Module, whose_pulse_width_is_in_its_first_register_has_it_set) {
    play({.kind = test::ModuleKind::moxa}, "moxa-iologik");
    options_.module_pulse = 40ms;
    options_.map.pulse_width_register = 0;
    start();
    ASSERT_TRUE(run_until([&] { return ear_.changes == 1; }));
    EXPECT_FALSE(ear_.up) << "this module has no such register: that it refuses shows that it was asked";
    EXPECT_THAT(ear_.why_down.what, HasSubstr("register 0 of the rejector module"));
}

TEST_F(Module, of_moxa_with_its_watchdog_alarm_up_is_given_free) {
    play({.kind = test::ModuleKind::moxa, .watchdog = 1s}, "moxa-iologik");
    start_and_wait();
    module_->misbehave(ModuleFault::silent, -1, {}, true);
    EXPECT_TRUE(run_until([&] { return module_->watchdog_expired(); }));
    module_->misbehave(ModuleFault::none);
    expect_recovered();
}

TEST_F(Module, of_advantech_has_its_outputs_from_coil_16_on_and_its_inputs_from_0) {
    play({.coils = 6, .kind = test::ModuleKind::adam}, "advantech-adam-6000");
    options_.ejector_coil = 16;
    options_.permit_coil = 17;
    options_.confirm_input = 11;
    options_.confirm_within = 400ms;
    module_->on_coil([this](int output, bool on, hal::TimePoint) {
        if (output == 0) module_->set_input(11, on);  // the ejected part passes the sensor
    });
    start_and_wait();
    rejector_->set_run_permit(true);
    EXPECT_TRUE(run_until([&] { return module_->coil(1); }));
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_EQ(times_on(0), 1);
    EXPECT_EQ(ear_.changes, 1);
}

TEST_F(Module, of_advantech_is_refused_with_an_input_for_an_output) {
    options_.map = map_of("advantech-adam-6000");
    options_.ejector_coil = 16;
    options_.permit_coil = 1;
    rejector_.emplace(*loop_, options_);
    const auto done = rejector_->start(ear_);
    ASSERT_FALSE(done);
    EXPECT_THAT(done.error().what, HasSubstr("is an input of this module: its first output is coil 16"));
}

TEST_F(Module, that_lacks_what_is_asked_for_is_refused_at_start) {
    options_.watchdog = 500ms;
    options_.module_pulse = 10ms;
    options_.energise_to_pass = true;
    rejector_.emplace(*loop_, options_);
    const auto done = rejector_->start(ear_);
    ASSERT_FALSE(done);
    EXPECT_THAT(
        done.error().what,
        AllOf(HasSubstr("watchdog must be 0"), HasSubstr("module_pulse must be 0"), HasSubstr("energise_to_pass")));
}

TEST_F(Module, says_what_it_is_where_it_can) {
    CoilLink plain(*loop_, options_.address, 10s);
    ASSERT_TRUE(plain.connect());
    EXPECT_EQ(plain.identify().value_or("nothing"), "HORD coil module 1.0");
    EXPECT_FALSE(plain.connected());
    play({.kind = test::ModuleKind::wago}, "wago-750");
    CoilLink wago(*loop_, options_.address, 10s);
    ASSERT_TRUE(wago.connect());
    const auto none = wago.identify();
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().code, ErrorCode::unsupported);
}

}  // namespace
}  // namespace hord::drivers
