// The rejector driver with the features of particular modules: read-back address, watchdog, pulses timed by the module,
// confirm sensor. The simulated modules follow the manuals, not the profiles.
#include <algorithm>
#include <thread>

#include <sys/socket.h>

#include "common/tcp_listener.h"
#include "drivers/modbus/coil_link.h"
#include "firmware/config/module_profiles.h"
#include "tests/drivers/modbus/rejector_bench.h"
#include "tests/support/answering_server.h"

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

// An answer with `count` objects, of which these follow; it comes after `delay`.
Result<std::string> identification(int count, const std::string& objects, hal::Duration delay = {}) {
    const test::AnsweringServer server([&](const std::string& sent) {
        std::this_thread::sleep_for(delay);
        const std::string data = std::string("\x2b\x0e\1\1\0\0", 6) + static_cast<char>(count) + objects;
        const std::size_t length = data.size() + 1;
        return sent.substr(0, 4) + static_cast<char>(length >> 8U) + static_cast<char>(length) + sent[6] + data;
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    EXPECT_TRUE(link.connect());
    return link.identify();
}

TEST(Identification, is_read_no_further_than_its_answer) {
    const std::string first("\0\4Acme", 6);
    EXPECT_EQ(identification(2, first + std::string("\1\2X1", 4)).value_or("nothing"), "Acme X1");
    EXPECT_EQ(identification(1, first + std::string("\1\2X1", 4)).value_or("nothing"), "Acme");
    EXPECT_EQ(identification(3, first).value_or("nothing"), "Acme") << "objects are missing";
    EXPECT_EQ(identification(2, first + '\1').value_or("nothing"), "Acme") << "cut before a length";
    EXPECT_EQ(identification(2, first + std::string("\1\x63X1", 4)).value_or("nothing"), "Acme X1") << "cut in a text";
}

// The error of identify() on a module that gives this answer, "\1" standing for the unit.
Error unidentified(const std::string& answer, int unit = 1) {
    const test::AnsweringServer server([&](const std::string& sent) { return sent.substr(0, 2) + answer; });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port(), .unit = unit}, 10s);
    EXPECT_TRUE(link.connect());
    const auto said = link.identify();
    EXPECT_FALSE(said) << *said;
    return said ? Error{} : said.error();
}

TEST(Identification, that_is_none_says_who_answers) {
    const std::string none("\0\0", 2), three("\0\3", 2), nine("\0\x9", 2), refused("\xAB", 1);
    struct Case {
        std::string answer;
        ErrorCode code;
        const char* what;
    };
    const Case cases[] = {
        {none + three + "\1" + refused + "\1", ErrorCode::unsupported, "has no device identification"},
        {none + three + "\1" + refused + "\xA", ErrorCode::refused, "a gateway does, in its place, for unit 1"},
        {none + three + "\1" + refused + "\xB", ErrorCode::refused, "a gateway does, in its place, for unit 1"},
        {none + three + "\7" + refused + "\1", ErrorCode::refused, "answers as unit 7, not as unit 1"},
        {none + std::string("\0\x9", 2) + "\7\x2b\xe\1\1" + std::string("\0\0\0", 3), ErrorCode::refused,
         "answers as unit 7, not as unit 1"},
        {std::string("\0\1", 2) + three + "\1" + refused + "\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {std::string("\1\0", 2) + three + "\1" + refused + "\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {none + three + "\1\x2a\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {none + nine + "\1\x2b\xf\1\1" + std::string("\0\0\0", 3), ErrorCode::unreadable,
         "not as a Modbus module does"},
        {none + std::string("\0\x7", 2) + "\1\x2b\xe\1\1" + std::string("\0", 1), ErrorCode::unreadable,
         "not as a Modbus module does"},
        {none + std::string("\0\2", 2) + "\1" + refused, ErrorCode::timeout, "does not say what it is"},
    };
    for (const Case& one : cases) {
        const Error error = unidentified(one.answer);
        EXPECT_EQ(error.code, one.code) << one.what;
        EXPECT_THAT(error.what, HasSubstr(one.what));
        EXPECT_FALSE(error.cure.empty());
    }
    EXPECT_THAT(unidentified(none + three + "\7" + refused + "\xA", 7).what, HasSubstr("for unit 7"));
}

TEST(Identification, shows_letters_and_a_question_mark_for_what_is_none) {
    EXPECT_EQ(identification(1,
                             std::string("\0\6", 2) +
                                 std::string(" ~\x1f\x7f\xe9"
                                             "A",
                                             6))
                  .value_or("nothing"),
              " ~???A");
    EXPECT_EQ(identification(3,
                             std::string("\0\1"
                                         "A\1\0\2\1"
                                         "C",
                                         8))
                  .value_or("nothing"),
              "A  C")
        << "an empty object between two spaces";
}

TEST(Identification, that_never_ends_is_read_up_to_the_longest_answer) {
    const std::string long_one = std::string("\0\xC8", 2) + std::string(200, 'a');
    const auto said = identification(3, long_one + std::string("\1\xC8", 2) + std::string(200, 'b') + long_one);
    ASSERT_TRUE(said) << said.error().message();
    EXPECT_THAT(*said, testing::StartsWith(std::string(200, 'a')));
}

TEST(Identification, that_ends_with_the_connection_is_told_as_that_and_not_as_silence) {
    const test::AnsweringServer server([](const std::string&) { return std::string(); });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    ASSERT_TRUE(link.connect());
    const auto said = link.identify();
    ASSERT_FALSE(said);
    EXPECT_THAT(said.error().what, HasSubstr("closes the connection without an answer as unit 1"));
}

TEST(Identification, of_a_module_that_thinks_is_waited_for) {
    EXPECT_EQ(identification(1, std::string("\0\4Acme", 6), 50ms).value_or("nothing"), "Acme");
}

// What read(5) makes of this answer; the requests are those of the link, so that `change` may build on them.
template <class Change>
Result<bool> read_of(Change change, int times = 1) {
    const test::AnsweringServer server(change);
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    Result<bool> done = false;
    for (int k = 0; k < times; ++k) {
        EXPECT_TRUE(link.connect());
        done = link.read(5);
    }
    EXPECT_EQ(link.connected(), done || done.error().code == ErrorCode::refused);
    return done;
}

// The header of the request with another length, then these bytes.
std::string with_pdu(const std::string& sent, const std::string& pdu) {
    return sent.substr(0, 4) + std::string(1, '\0') + static_cast<char>(pdu.size() + 1) + sent[6] + pdu;
}

TEST(CoilLink, asks_for_one_coil_and_takes_its_lowest_bit) {
    std::string asked;
    for (const char value : {'\0', '\1', '\2', '\xFF'}) {
        const auto read = read_of([&](const std::string& sent) {
            asked = sent;
            return with_pdu(sent, std::string("\1\1") + value);
        });
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(*read, (value & 1) != 0);
    }
    EXPECT_EQ(asked, std::string("\0\1\0\0\0\6\1\1\0\5\0\1", 12));
}

TEST(CoilLink, tells_what_is_wrong_with_an_answer) {
    struct Case {
        std::string pdu;
        ErrorCode code;
        const char *what, *cure;
    };
    const Case cases[] = {
        {"\x81\1", ErrorCode::refused, "has no such output or register", "hordctl devices --module"},
        {"\x81\2", ErrorCode::refused, "has no such output or register", "rejector.profile"},
        {"\x81\3", ErrorCode::refused, "has no such output or register", "rejector.unit"},
        {"\x81\4", ErrorCode::refused, "coil 5 of the rejector module at 127.0.0.1:", "the module's own fault display"},
        {"\x81\6", ErrorCode::refused, "cannot be read: ", "the module's own fault display"},
        {"\x81\xA", ErrorCode::refused, "a gateway answers, not the module behind it", "behind the gateway"},
        {"\x81\xB", ErrorCode::refused, "a gateway answers, not the module behind it", "behind the gateway"},
        {"\x81\xC", ErrorCode::disconnected, "the answer is none of Modbus", "is the rejector's module really at"},
        {std::string("\x81\0", 2), ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
        {"\2\1\1", ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
        {"\1\2\1\1", ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
    };
    for (const Case& one : cases) {
        const auto read = read_of([&](const std::string& sent) { return with_pdu(sent, one.pdu); });
        ASSERT_FALSE(read) << one.pdu;
        EXPECT_EQ(read.error().code, one.code) << one.what;
        EXPECT_THAT(read.error().what, HasSubstr(one.what));
        EXPECT_THAT(read.error().cure, HasSubstr(one.cure));
    }
}

TEST(CoilLink, takes_no_answer_to_another_request_and_says_so_of_that_request_alone) {
    for (const std::size_t at : {0U, 1U, 2U, 3U}) {
        const auto read = read_of([&](const std::string& sent) {
            std::string answer = with_pdu(sent, "\1\1\1");
            answer[at] = static_cast<char>(answer[at] + 1);
            return answer;
        });
        ASSERT_FALSE(read) << at;
        EXPECT_THAT(read.error().what, HasSubstr("the answer is none of Modbus"));
    }
    const auto of_another = [](std::string sent) {
        sent = with_pdu(sent, "\1\1\1");
        sent[6] = 9;
        return sent;
    };
    const auto first = read_of(of_another);
    ASSERT_FALSE(first);
    EXPECT_THAT(first.error().what, HasSubstr("unit 9 answers, not unit 1"));
    EXPECT_THAT(first.error().cure, HasSubstr("such as a gateway"));
    int answers = 0;
    const auto second = read_of(
        [&](const std::string& sent) { return ++answers == 1 ? of_another(sent) : with_pdu(sent, "\2\1\1"); }, 2);
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().what, HasSubstr("the answer is none of Modbus"));
}

TEST(CoilLink, that_is_not_connected_asks_nothing) {
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = 1}, 1s);
    EXPECT_EQ(link.read(5).error().code, ErrorCode::disconnected);
    EXPECT_EQ(link.identify().error().code, ErrorCode::disconnected);
    const auto refused = link.connect();
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::disconnected);
    EXPECT_THAT(refused.error().what, HasSubstr("127.0.0.1:1 cannot be reached: Connection refused"));
    EXPECT_FALSE(link.connected());
    EXPECT_EQ(link.typical_response(), hal::Duration::zero());
}

// Nobody accepts its connections, and its queue is full.
TEST(CoilLink, to_a_host_that_takes_no_connection_says_that_it_does_not_answer) {
    auto listener = common::listen_on("test", "127.0.0.1", 0);
    ASSERT_TRUE(listener);
    ASSERT_EQ(::listen(listener->get(), 0), 0);
    const auto loop = std::move(*firmware::SdEventLoop::open());
    const ModuleAddress address{.host = "127.0.0.1", .port = common::local_port(listener->get())};
    CoilLink first(*loop, address, 10s), second(*loop, address, 700ms);
    ASSERT_TRUE(first.connect());
    const hal::TimePoint from = loop->now();
    const auto unanswered = second.connect();
    EXPECT_GE(loop->now() - from, 700ms);
    ASSERT_FALSE(unanswered);
    EXPECT_EQ(unanswered.error().code, ErrorCode::timeout);
    EXPECT_THAT(unanswered.error().what, HasSubstr("does not answer"));
    EXPECT_THAT(unanswered.error().cure, HasSubstr("rejector.host"));
}

TEST(Registers, have_their_high_byte_first) {
    const test::AnsweringServer server([](const std::string& sent) {
        return sent.substr(0, 5) + std::string("\x07", 1) + sent.substr(6, 2) + std::string("\4\1\2\3\4");
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    ASSERT_TRUE(link.connect());
    EXPECT_THAT(link.read_registers(CoilLink::RegisterKind::holding, 0, 2).value_or(std::vector<std::uint16_t>{}),
                testing::ElementsAre(0x0102, 0x0304));
}

TEST(Registers, are_named_by_their_kind) {
    const test::AnsweringServer server([](const std::string& sent) {
        const char function = static_cast<char>(static_cast<unsigned char>(sent[7]) | 0x80U);
        return with_pdu(sent, {function, '\2'});
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    using Kind = CoilLink::RegisterKind;
    for (const auto& [kind, name] : {std::pair(Kind::holding, "register 7 of"), {Kind::input, "input register 7 of"}}) {
        ASSERT_TRUE(link.connect());
        EXPECT_THAT(link.read_registers(kind, 7, 1).error().what, testing::StartsWith(name));
    }
}

// ---- the confirm sensor

constexpr int kChute = 3;

class Chute : public Module {
  protected:
    Chute() {
        options_.confirm_input = kChute;
        options_.confirm_within = 400ms;
    }
    // A part falls past the sensor while the ejector acts.
    void let_parts_fall(bool active_low = false) {
        module_->on_coil([this, active_low](int coil, bool on, hal::TimePoint) {
            if (coil == kEjector) module_->set_input(kChute, on != active_low);
        });
    }
};

TEST_F(Chute, a_part_that_arrives_confirms_its_command_with_the_time_of_the_acknowledgement) {
    let_parts_fall();
    start_and_wait();
    const hal::TimePoint asked = loop_->now();
    EXPECT_EQ(reject(1), Outcome::confirmed);
    EXPECT_GE(ear_.reports[0].at, asked);
    EXPECT_LT(ear_.reports[0].at, asked + kWindow);
}

TEST_F(Chute, a_part_that_never_arrives_leaves_its_command_unconfirmed_although_the_coil_moved) {
    start_and_wait();
    EXPECT_EQ(reject(1, 600ms), Outcome::failed);
    EXPECT_EQ(times_on(kEjector), 1);
    EXPECT_TRUE(ear_.up);
    ASSERT_EQ(ear_.failures.size(), 1U);
    EXPECT_EQ(ear_.failures[0].what, "the confirm sensor (input 3) did not see part 1 within 400 ms of its pulse");
}

TEST_F(Chute, a_sensor_that_is_covered_all_the_time_confirms_nothing) {
    module_->set_input(kChute, true);
    start_and_wait();
    EXPECT_EQ(reject(1, 600ms), Outcome::failed);
}

TEST_F(Chute, one_part_confirms_one_command) {
    start_and_wait();
    const hal::TimePoint start = loop_->now();
    ASSERT_TRUE(rejector_->reject({1, start, kWindow}));
    ASSERT_TRUE(rejector_->reject({2, start + 1ms, kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    loop_->call_after(100ms, [&] { module_->set_input(kChute, true); });
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 2; }));
    EXPECT_EQ(ear_.reports[0].outcome, Outcome::confirmed);
    EXPECT_EQ(ear_.reports[0].part, 1U);
    EXPECT_EQ(ear_.reports[1].outcome, Outcome::failed);
}

TEST_F(Chute, two_parts_confirm_two_commands_in_their_order) {
    options_.check_every = 3600s;
    start_and_wait();
    const hal::TimePoint start = loop_->now();
    ASSERT_TRUE(rejector_->reject({1, start, kWindow}));
    ASSERT_TRUE(rejector_->reject({2, start + 1ms, kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    module_->set_input(kChute, true);
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() == 1; }));
    module_->set_input(kChute, false);
    module_->misbehave_at_reads(ModuleFault::late, 3);  // counted, and answered as ever: the driver saw it
    ASSERT_TRUE(run_until([&] { return module_->misbehaved() == 3; }));
    module_->set_input(kChute, true);
    ASSERT_TRUE(run_until([&] { return !module_->coil(kEjector); }));
    loop_->run_until([] { return false; }, options_.confirm_within + 100ms);
    ASSERT_EQ(ear_.reports.size(), 2U);
    for (std::size_t k = 0; k < 2; ++k) {
        EXPECT_EQ(ear_.reports[k].outcome, Outcome::confirmed);
        EXPECT_EQ(ear_.reports[k].part, k + 1);
    }
    EXPECT_THAT(ear_.failures, testing::IsEmpty());
}

TEST_F(Chute, a_sensor_may_be_active_low) {
    options_.confirm_active_low = true;
    module_->set_input(kChute, true);  // at rest
    let_parts_fall(true);
    start_and_wait();
    EXPECT_EQ(reject(1), Outcome::confirmed);
}

TEST_F(Chute, a_link_that_goes_while_a_part_is_awaited_leaves_it_unconfirmed) {
    start_and_wait();
    const std::size_t before = ear_.reports.size();
    ASSERT_TRUE(rejector_->reject({1, loop_->now(), kWindow}));
    ASSERT_TRUE(run_until([&] { return module_->coil(kEjector); }));
    module_->power_off();
    ASSERT_TRUE(run_until([&] { return ear_.reports.size() > before; }));
    EXPECT_EQ(ear_.reports.back().outcome, Outcome::failed);
}

}  // namespace
}  // namespace hord::drivers
