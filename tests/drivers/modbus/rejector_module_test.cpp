// What the driver asks a Modbus module, request by request, and when: by a server that records what it is asked and a
// clock that only the server moves.
#include "drivers/modbus/rejector_module.h"

#include <array>
#include <atomic>
#include <map>
#include <mutex>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include "tests/support/answering_server.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Requests = std::vector<std::string>;

constexpr hal::TimePoint at(hal::Duration t) { return hal::TimePoint(10s + t); }

struct ServersClock final : hal::Clock {
    std::atomic<std::int64_t> ns{at({}).time_since_epoch().count()};
    [[nodiscard]] hal::TimePoint now() const override { return hal::TimePoint(hal::Duration(ns)); }
};

// Answers one connection after the other; coils and inputs read as they were set or written.
class RecordingServer {
  public:
    explicit RecordingServer(ServersClock& clock) : clock_(clock) {}
    [[nodiscard]] ModuleAddress address() const { return {.host = "127.0.0.1", .port = server_.port()}; }
    // Since the last call: "coil 1=1", "register 4096=15", "coil 1?", "input 3?".
    Requests asked() {
        const std::lock_guard lock(mutex_);
        return std::exchange(asked_, {});
    }
    void set(const std::string& what, bool on) {
        const std::lock_guard lock(mutex_);
        bits_[what] = on;
    }
    void answer_after(hal::Duration time) { takes_ns_ = time.count(); }  // of the clock
    void refuse(const std::string& what) {
        const std::lock_guard lock(mutex_);
        refused_ = what;
    }
    void stick(const std::string& what) {
        const std::lock_guard lock(mutex_);
        stuck_ = what;
    }

  private:
    void serve(int client) {
        std::array<unsigned char, 12> bytes{};
        while (::recv(client, bytes.data(), bytes.size(), MSG_WAITALL) == 12) {
            std::string reply(reinterpret_cast<const char*>(bytes.data()), bytes.size());
            const int number = bytes[8] << 8 | bytes[9], value = bytes[10] << 8 | bytes[11], function = bytes[7];
            const std::string what = (function == 2       ? "input "
                                          : function == 6 ? "register "
                                                          : "coil ") +
                std::to_string(number);
            {
                const std::lock_guard lock(mutex_);
                const bool reads = function < 5;
                asked_.push_back(what + (reads ? "?" : "=" + std::to_string(value == 0xFF00 ? 1 : value)));
                if (asked_.back() == refused_) {
                    reply = reply.substr(0, 5) + "\3" + reply[6] + static_cast<char>(function | 0x80) + "\4";
                } else if (reads) {
                    EXPECT_EQ(value, 1) << "one bit";
                    reply = reply.substr(0, 5) + "\4" + reply.substr(6, 2) + "\1" +
                        (bits_[what] ? "\1" : std::string(1, '\0'));
                } else if (function == 5 && what != stuck_) {
                    bits_[what] = value != 0;
                }
            }
            clock_.ns += takes_ns_;
            (void)::send(client, reply.data(), reply.size(), MSG_NOSIGNAL);
        }
    }

    ServersClock& clock_;
    std::mutex mutex_;
    Requests asked_;
    std::map<std::string, bool> bits_;
    std::string refused_, stuck_;
    std::atomic<std::int64_t> takes_ns_ = 0;
    const test::LoopbackServer server_{[this](int client) { serve(client); }};  // last: its thread uses the others
};

class AskedModule : public testing::Test {
  protected:
    AskedModule() {
        options_.address = server_.address();
        options_.ejector_coil = 4;
        options_.permit_coil = 5;
        options_.response_timeout = 10s;
    }
    RejectorModule& module() {
        if (!module_) module_.emplace(clock_, options_);
        return *module_;
    }
    // A module with a watchdog whose time is in steps of 100 ms.
    void with_watchdog(hal::Duration time) {
        options_.watchdog = time;
        options_.map.watchdog_time_register = 0x1000;
        options_.map.watchdog_trigger_register = 0x1003;
        options_.map.watchdog_stop_register = 0x1008;
        options_.map.watchdog_stop_value = 0x55AA;
    }
    ServersClock clock_;
    RecordingServer server_{clock_};
    ModbusRejectorOptions options_;
    std::optional<RejectorModule> module_;
};

TEST_F(AskedModule, is_made_safe_first_and_each_output_is_read_back) {
    ASSERT_TRUE(module().connect());
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 4?", "coil 5=0", "coil 5?"));
    ASSERT_TRUE(module().start_pulse());
    ASSERT_TRUE(module().set_permit(true));
    ASSERT_TRUE(module().end_pulse());
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=1", "coil 4?", "coil 5=1", "coil 5?", "coil 4=0", "coil 4?"));
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 4?", "coil 5=0", "coil 5?"));
    EXPECT_FALSE(module().link().connected());
}

TEST_F(AskedModule, without_a_permit_has_none_written) {
    options_.permit_coil = -1;
    ASSERT_TRUE(module().connect());
    ASSERT_TRUE(module().set_permit(true));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 4?"));
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 4?"));
}

TEST_F(AskedModule, that_is_read_back_elsewhere_is_read_there) {
    options_.map.read_back_offset = 100;
    options_.energise_to_pass = true;
    options_.permit_coil = -1;
    server_.set("coil 104", true);
    ASSERT_TRUE(module().connect()) << "energised at rest";
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=1", "coil 104?"));
    EXPECT_TRUE(module().check_ejector(false));
    const auto pulse = module().check_ejector(true);
    ASSERT_FALSE(pulse);
    EXPECT_EQ(pulse.error().code, ErrorCode::disconnected);
    EXPECT_THAT(pulse.error().what, HasSubstr("lost its outputs: coil 4 is 1 ("));
    server_.set("coil 104", false);
    EXPECT_TRUE(module().check_ejector(true));
    EXPECT_THAT(module().check_ejector(false).error().what, HasSubstr("coil 4 is 0 ("));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 104?", "coil 104?", "coil 104?", "coil 104?"));
    ASSERT_TRUE(module().start_pulse());
    const auto refused = module().end_pulse();
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what,
                HasSubstr("answered, but reads back 0 where 1 was written (it is read at coil 104)"));
    EXPECT_TRUE(module().link().connected());
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 104?", "coil 4=1", "coil 104?", "coil 4=0", "coil 104?"))
        << "0 rejects: nothing passes without a link";
}

TEST_F(AskedModule, has_its_permit_checked_where_it_is) {
    options_.map.read_back_offset = 100;
    ASSERT_TRUE(module().connect());
    (void)server_.asked();
    EXPECT_TRUE(module().check_permit(false));
    EXPECT_THAT(module().check_permit(true).error().what, HasSubstr("coil 5 is 0 ("));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 105?", "coil 105?"));
}

TEST_F(AskedModule, that_times_the_pulse_has_its_width_set_and_no_end_written) {
    options_.module_pulse = 45ms;
    options_.map.pulse_coil_offset = 16;
    options_.map.pulse_width_register = 7;
    ASSERT_TRUE(module().connect());
    EXPECT_TRUE(module().times_pulse());
    EXPECT_THAT(server_.asked(), ElementsAre("register 7=45", "coil 20=0", "coil 5=0", "coil 5?"));
    ASSERT_TRUE(module().start_pulse());
    EXPECT_FALSE(module().check_ejector(false)) << "its pulse coil is up";
    EXPECT_THAT(server_.asked(), ElementsAre("coil 20=1", "coil 20?"));
    server_.set("coil 20", false);
    EXPECT_TRUE(module().check_ejector(false));
    (void)server_.asked();
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 20=0", "coil 5=0", "coil 5?"));
}

TEST_F(AskedModule, has_its_watchdog_set_to_the_next_step_and_triggered_by_other_values) {
    for (const auto& [time, steps] : {std::pair(hal::Duration(1500ms), 15), std::pair(hal::Duration(1500ms + 1ns), 16),
                                      std::pair(hal::Duration(1599ms), 16)}) {
        with_watchdog(time);
        module_.reset();
        (void)server_.asked();
        ASSERT_TRUE(module().connect());
        EXPECT_THAT(server_.asked(),
                    ElementsAre("register 4104=21930", "register 4096=" + std::to_string(steps), "register 4099=1",
                                "register 4099=2", "coil 4=0", "coil 4?", "coil 5=0", "coil 5?"));
        EXPECT_EQ(module().watchdog_due(), clock_.now() + time / 3);
    }
    clock_.ns += 1'000'000;
    ASSERT_TRUE(module().trigger_watchdog());
    ASSERT_TRUE(module().trigger_watchdog());
    EXPECT_EQ(module().watchdog_due(), clock_.now() + options_.watchdog / 3);
    EXPECT_THAT(server_.asked(), ElementsAre("register 4099=1", "register 4099=2"));
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 4=0", "coil 4?", "coil 5=0", "coil 5?", "register 4104=21930"));
}

TEST_F(AskedModule, without_a_watchdog_is_never_due) {
    ASSERT_TRUE(module().connect());
    EXPECT_EQ(module().watchdog_due(), hal::TimePoint::max());
}

TEST_F(AskedModule, whose_alarm_is_up_is_given_free_before_anything_else) {
    options_.map.alarm_coil = 0;
    ASSERT_TRUE(module().connect());
    EXPECT_THAT(server_.asked(), ElementsAre("coil 0?", "coil 4=0", "coil 4?", "coil 5=0", "coil 5?"));
    module_.reset();
    server_.set("coil 0", true);
    ASSERT_TRUE(module().connect());
    EXPECT_THAT(server_.asked(), ElementsAre("coil 0?", "coil 0=1", "coil 4=0", "coil 4?", "coil 5=0", "coil 5?"));
}

TEST_F(AskedModule, that_refuses_a_step_of_its_beginning_is_not_used) {
    with_watchdog(1s);
    options_.map.alarm_coil = 0;
    options_.module_pulse = 45ms;
    options_.map.pulse_coil_offset = 16;
    options_.map.pulse_width_register = 7;
    options_.confirm_input = 3;
    server_.set("coil 0", true);
    const Requests all{
        "coil 0?",       "coil 0=1", "register 4104=21930", "register 4096=10", "register 4099=1", "register 4099=2",
        "register 7=45", "input 3?", "coil 20=0",           "coil 5=0",         "coil 5?"};
    ASSERT_TRUE(module().connect());
    EXPECT_EQ(server_.asked(), all);
    for (std::size_t k = 0; k < all.size(); ++k) {
        module_.reset();
        server_.set("coil 0", true);
        server_.refuse(all[k]);
        const auto refused = module().connect();
        ASSERT_FALSE(refused) << all[k];
        EXPECT_EQ(refused.error().code, ErrorCode::refused);
        EXPECT_EQ(server_.asked(), Requests(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(k) + 1));
    }
}

TEST_F(AskedModule, sees_a_part_arrive_once_and_not_one_that_was_there_before) {
    options_.confirm_input = 3;
    for (const bool active_low : {false, true}) {
        options_.confirm_active_low = active_low;
        module_.reset();
        const auto sensor = [&](bool part) { server_.set("input 3", part != active_low); };
        sensor(true);
        ASSERT_TRUE(module().connect());
        EXPECT_TRUE(module().part_present());
        EXPECT_FALSE(module().part_arrived().value());
        sensor(false);
        EXPECT_FALSE(module().part_arrived().value());
        EXPECT_FALSE(module().part_present());
        sensor(true);
        EXPECT_TRUE(module().part_arrived().value());
        EXPECT_TRUE(module().part_present());
        EXPECT_FALSE(module().part_arrived().value());
    }
    (void)server_.asked();
    (void)module().part_arrived();
    EXPECT_THAT(server_.asked(), ElementsAre("input 3?"));
}

TEST_F(AskedModule, that_refuses_to_be_made_safe_is_asked_three_times_and_the_rest_of_it_each_time) {
    ASSERT_TRUE(module().connect());
    (void)server_.asked();
    server_.refuse("coil 4=0");
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(),
                ElementsAre("coil 4=0", "coil 5=0", "coil 5?", "coil 4=0", "coil 5=0", "coil 5?", "coil 4=0",
                            "coil 5=0", "coil 5?"));
    EXPECT_FALSE(module().link().connected());
}

TEST_F(AskedModule, without_a_link_is_left_alone_at_the_end) {
    ASSERT_TRUE(module().connect());
    (void)server_.asked();
    module().link().close();
    module().make_safe(at(60s));
    EXPECT_THAT(server_.asked(), IsEmpty());
}

// ---- times

TEST_F(AskedModule, takes_for_typical_the_longest_answer_and_forgets_an_eighth_of_it_with_each) {
    CoilLink link(clock_, options_.address, 10s);
    ASSERT_TRUE(link.connect());
    const auto ask_for = [&](hal::Duration time) {
        server_.answer_after(time);
        EXPECT_TRUE(link.read(1));
        return link.typical_response();
    };
    EXPECT_EQ(ask_for(80ms), 80ms);
    EXPECT_EQ(ask_for(0ms), 70ms);
    EXPECT_EQ(ask_for(64ms), 64ms);
    EXPECT_EQ(ask_for(0ms), 56ms);
    server_.refuse("coil 1?");
    server_.answer_after(90ms);
    EXPECT_FALSE(link.read(1));
    EXPECT_EQ(link.typical_response(), 90ms) << "a refusal is an answer";
}

TEST_F(AskedModule, has_acknowledged_a_write_before_it_is_read_back) {
    CoilLink link(clock_, options_.address, 10s);
    ASSERT_TRUE(link.connect());
    server_.answer_after(30ms);
    ASSERT_TRUE(link.write(1, true, 1));
    EXPECT_EQ(link.acknowledged(), at(30ms));
    EXPECT_EQ(clock_.now(), at(60ms));
    ASSERT_TRUE(link.write(1, false));
    EXPECT_EQ(link.acknowledged(), at(90ms));
    server_.stick("coil 1");
    const auto stuck = link.write(1, true, 1);
    ASSERT_FALSE(stuck);
    EXPECT_EQ(stuck.error().code, ErrorCode::refused);
    EXPECT_THAT(stuck.error().what, HasSubstr("answered, but reads back 0 where 1 was written"));
    EXPECT_THAT(stuck.error().what, testing::Not(HasSubstr("it is read at")));
    EXPECT_TRUE(link.write(1, true)) << "without reading back it is taken at its word";
    server_.set("coil 1", true);
    EXPECT_THAT(link.write(1, false, 1).error().what, HasSubstr("reads back 1 where 0 was written"));
    server_.refuse("coil 1=1");
    (void)server_.asked();
    EXPECT_FALSE(link.write(1, true, 1));
    EXPECT_THAT(server_.asked(), ElementsAre("coil 1=1")) << "what was refused is not read back";
}

TEST_F(AskedModule, is_named_as_a_person_names_it) {
    EXPECT_EQ(CoilLink(clock_, {.host = "10.0.0.7", .port = 1502}, 1s).name(), "10.0.0.7:1502");
    EXPECT_EQ(CoilLink(clock_, {.host = "fe80::1"}, 1s).name(), "[fe80::1]:502");
    EXPECT_EQ(CoilLink(clock_, {.serial = SerialSettings{.device = "/dev/ttyS1"}, .unit = 7}, 1s).name(),
              "/dev/ttyS1 unit 7");
}

}  // namespace
}  // namespace hord::drivers
