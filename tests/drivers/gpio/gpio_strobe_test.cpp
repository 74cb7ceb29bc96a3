// The strobe on scripted lines: which pulses it accepts, and that the lights are off otherwise.
#include "drivers/gpio/gpio_strobe.h"

#include <optional>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "tests/drivers/gpio/scripted_lines.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using hal::Duration;
using hal::TimePoint;
using testing::HasSubstr;

// Long enough for a busy machine.
constexpr Duration kPatience = 120s;

struct Ear final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::StrobeReport> reports;
    std::vector<Error> losses;
};

struct GpioStrobeTest : testing::Test {
    void open(std::vector<LightLimits> limits) {
        auto opened = GpioStrobe::open(*loop, std::move(limits), [this] { return scripted::Outputs::request(lamps); });
        ASSERT_TRUE(opened) << opened.error().message();
        strobe = std::move(*opened);
    }
    bool run_until(const std::function<bool()>& done) { return loop->run_until(done, kPatience); }
    // Late enough to be accepted, early enough for a short test.
    hal::StrobePulse pulse(std::uint32_t exposure, std::uint32_t channels, Duration width, Duration ahead = 20ms) {
        return {.exposure = exposure, .channels = channels, .start = loop->now() + ahead, .width = width};
    }

    std::unique_ptr<firmware::SdEventLoop> loop = std::move(*firmware::SdEventLoop::open());
    std::shared_ptr<scripted::Lamps> lamps = std::make_shared<scripted::Lamps>(*loop);
    hal::EventLoop::TimerId timer{};
    Ear ear;
    std::unique_ptr<GpioStrobe> strobe;
};

TEST_F(GpioStrobeTest, lights_are_off_from_the_moment_the_lines_are_taken_and_the_lines_stay_held) {
    open({{}, {}});
    EXPECT_EQ(lamps->taken, 1);
    EXPECT_EQ(lamps->history().front().active, 0U);
    ASSERT_TRUE(strobe->start(ear));
    strobe->stop();
    EXPECT_EQ(lamps->taken, 1);
    EXPECT_FALSE(lamps->ever_lit());
    strobe.reset();
    EXPECT_EQ(lamps->taken, 0);
}

TEST_F(GpioStrobeTest, a_pulse_lights_its_channels_alone_and_is_reported_as_it_was) {
    open(std::vector<LightLimits>(3, {.max_on = 1s, .min_rest = 0ms, .max_duty = 1}));
    ASSERT_TRUE(strobe->start(ear));
    const auto asked = pulse(5, 0b101, 1s);
    ASSERT_TRUE(strobe->fire(asked));
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty(); }));
    const auto& report = ear.reports[0];
    EXPECT_TRUE(report.lit);
    const auto moves = lamps->history();
    ASSERT_GE(moves.size(), 3U);
    const auto on = std::ranges::find(moves, 0b101U, &scripted::Lamps::Move::active);
    ASSERT_NE(on, moves.end());
    const auto off = on + 1;
    EXPECT_EQ(off->active, 0U);
    EXPECT_GE(report.start, asked.start);
    EXPECT_GE(on->at, report.start);
    EXPECT_GE(report.width, asked.width);
    EXPECT_LE(off->at, report.start + report.width);
    EXPECT_EQ(lamps->now_active(), 0U);
    strobe->stop();
}

TEST_F(GpioStrobeTest, each_channel_has_limits_of_its_own) {
    open({{.max_on = 2ms, .min_rest = 0ms, .max_duty = 1},
          {.max_on = 500us, .min_rest = 50ms, .max_duty = 1},
          {.max_on = 2ms, .min_rest = 0ms, .max_duty = 0.1}});
    ASSERT_TRUE(strobe->start(ear));
    const auto refusal = [&](const hal::StrobePulse& p) {
        const auto done = strobe->fire(p);
        return done ? std::optional<ErrorCode>() : done.error().code;
    };
    auto next = pulse(1, 0b010, 501us, 1h);
    EXPECT_EQ(refusal(next), ErrorCode::invalid_argument);
    next.channels = 0b011;
    EXPECT_EQ(refusal(next), ErrorCode::invalid_argument);
    next.width = 500us;
    EXPECT_EQ(refusal(next), std::nullopt);
    next.start += next.width;
    EXPECT_EQ(refusal(next), ErrorCode::busy);  // channel 0b010 must still rest
    next.channels = 0b001;
    EXPECT_EQ(refusal(next), std::nullopt);  // channel 0b001 need not rest
    next.start += next.width;
    next.channels = 0b100;
    EXPECT_EQ(refusal(next), std::nullopt);
    next.start += next.width + 4499us;  // 500 us in 5 ms: a duty of 10 %
    EXPECT_EQ(refusal(next), ErrorCode::busy);
    next.start += 1us;
    EXPECT_EQ(refusal(next), std::nullopt);
    strobe->stop();
    EXPECT_FALSE(lamps->ever_lit());
}

TEST_F(GpioStrobeTest, a_pulse_whose_time_is_over_lights_nothing) {
    open({{}});
    ASSERT_TRUE(strobe->start(ear));
    ASSERT_TRUE(strobe->fire(pulse(9, 1, 1ms, -10ms)));
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty(); }));
    EXPECT_FALSE(ear.reports[0].lit);
    EXPECT_FALSE(lamps->ever_lit());
    strobe->stop();
}

// The limits hold for the real pulses, also when the thread is late.
TEST_F(GpioStrobeTest, the_light_rests_from_its_true_end) {
    open({{.max_on = 400ms, .min_rest = 10ms, .max_duty = 1}});
    ASSERT_TRUE(strobe->start(ear));
    auto next = pulse(0, 1, 400ms);
    for (std::uint32_t k = 1; k <= 3; ++k) {
        next.exposure = k;
        ASSERT_TRUE(strobe->fire(next));
        next.start += 410ms;
    }
    ASSERT_TRUE(run_until([&] { return ear.reports.size() == 3; }));
    strobe->stop();
    std::optional<TimePoint> off;
    bool lit = false;
    int rests = 0;
    for (const auto& move : lamps->history()) {
        if (move.active != 0 && off) {
            EXPECT_GE(move.at - *off, 10ms);
            ++rests;
        }
        if (lit && move.active == 0) off = move.at;
        lit = move.active != 0;
    }
    EXPECT_GE(rests, 1);
}

TEST_F(GpioStrobeTest, stop_ends_a_light_that_is_on) {
    open({{.max_on = 1h, .min_rest = 0ms, .max_duty = 1}});
    ASSERT_TRUE(strobe->start(ear));
    ASSERT_TRUE(strobe->fire(pulse(3, 1, 1h, 1ms)));
    ASSERT_TRUE(run_until([&] { return lamps->now_active() == 1; }));
    strobe->stop();
    EXPECT_EQ(lamps->now_active(), 0U);
    ASSERT_EQ(ear.reports.size(), 1U);
    EXPECT_LT(ear.reports[0].width, 1h);
}

TEST_F(GpioStrobeTest, a_line_that_cannot_be_set_is_let_go_of_and_every_pulse_is_reported) {
    open({{}});
    ASSERT_TRUE(strobe->start(ear));
    for (std::uint32_t k = 1; k <= 3; ++k) ASSERT_TRUE(strobe->fire(pulse(k, 1, 1ms, 10ms + k * 50ms)));
    lamps->be_there(false);
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    EXPECT_EQ(lamps->taken, 0);
    EXPECT_EQ(ear.reports.size(), 3U);
    for (const auto& report : ear.reports) EXPECT_FALSE(report.lit);
    EXPECT_EQ(strobe->fire(pulse(4, 1, 1ms, 1s)).error().code, ErrorCode::disconnected);
    strobe->stop();
    EXPECT_FALSE(strobe->start(ear));
    lamps->be_there(true);
    EXPECT_TRUE(strobe->start(ear));
    strobe->stop();
    EXPECT_EQ(ear.losses.size(), 1U);
}

// The kernel does not report it. Without the check an idle station would not know that the strobe is lost and would not
// restart it with its other lost devices; the next part would get no light.
TEST_F(GpioStrobeTest, a_chip_that_went_away_is_noticed_without_a_pulse) {
    open({{}});
    ASSERT_TRUE(strobe->start(ear));
    lamps->be_there(false);
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    EXPECT_EQ(ear.losses[0].code, ErrorCode::disconnected);
    EXPECT_EQ(lamps->taken, 0);
    EXPECT_TRUE(ear.reports.empty());
    lamps->be_there(true);
    EXPECT_EQ(strobe->fire(pulse(1, 1, 1ms)).error().code, ErrorCode::disconnected);  // until it is started again
    strobe->stop();
    ASSERT_TRUE(strobe->start(ear));
    ASSERT_TRUE(strobe->fire(pulse(2, 1, 1ms, 1s)));
    ASSERT_TRUE(run_until([&] { return !ear.reports.empty(); }));
    EXPECT_EQ(ear.reports[0].exposure, 2U);
    EXPECT_EQ(ear.losses.size(), 1U);
    strobe->stop();
}

// Also while a pulse is planned for much later.
TEST_F(GpioStrobeTest, a_chip_that_went_away_is_noticed_long_before_the_next_pulse) {
    open({{}});
    ASSERT_TRUE(strobe->start(ear));
    ASSERT_TRUE(strobe->fire(pulse(1, 1, 1ms, 24h)));
    lamps->be_there(false);
    ASSERT_TRUE(run_until([&] { return !ear.losses.empty(); }));
    ASSERT_EQ(ear.reports.size(), 1U);
    EXPECT_FALSE(ear.reports[0].lit);
    strobe->stop();
}

TEST_F(GpioStrobeTest, impossible_limits_are_all_named) {
    const auto opened = GpioStrobe::open(*loop, {{.max_on = 0ns, .min_rest = -1ns, .max_duty = 0}},
                                         [this] { return scripted::Outputs::request(lamps); });
    ASSERT_FALSE(opened);
    for (const char* what : {"max_on", "min_rest", "max_duty"}) EXPECT_THAT(opened.error().what, HasSubstr(what));
}

TEST(LightBudget, accepted_pulses_keep_every_limit_over_any_time) {
    std::mt19937_64 random(7);
    const auto up_to = [&](Duration most) {
        return Duration(std::uniform_int_distribution<std::int64_t>(1, most.count())(random));
    };
    for (int round = 0; round < 200; ++round) {
        const LightLimits limits{up_to(3ms), up_to(8ms), std::uniform_real_distribution<>(0.01, 1)(random)};
        hal::LightBudget budget({limits});
        TimePoint at(1s);
        std::vector<std::pair<TimePoint, Duration>> lit;
        for (int k = 0; k < 200; ++k) {
            at += up_to(6ms);
            const Duration width = up_to(4ms);
            if (!budget.check(1, at, width)) continue;
            budget.spend(1, at, width);
            lit.emplace_back(at, width);
        }
        ASSERT_FALSE(lit.empty());
        for (std::size_t first = 0; first < lit.size(); ++first) {
            EXPECT_LE(lit[first].second, limits.max_on);
            if (first > 0) {
                EXPECT_GE(lit[first].first, lit[first - 1].first + lit[first - 1].second + limits.min_rest);
            }
            Duration on{};
            for (std::size_t k = first; k + 1 < lit.size(); ++k) {
                on += lit[k].second;
                const auto over = static_cast<double>((lit[k + 1].first - lit[first].first).count());
                EXPECT_LE(static_cast<double>(on.count()),
                          limits.max_duty * over + 1.0 * static_cast<double>(k - first + 1));  // ns of rounding
            }
        }
    }
}

}  // namespace
}  // namespace hord::drivers
