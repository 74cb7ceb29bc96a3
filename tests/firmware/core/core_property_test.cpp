// Random events against a shadow model: the guarantees of core.h hold for any sequence of events.
//
// The events are adversarial: frames with wrong time stamps, counts and sizes; judgements of any part at any time;
// reports repeated or missing; devices lost and back; random commands; late ticks. The model knows only the events sent
// and checks every action.
#include <map>
#include <random>

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

class Shadow {
  public:
    Shadow(std::uint64_t seed, const CoreConfig& config) : config_(config), core_(config), random_(seed) {}

    void run(int events) {
        const Event start[] = {Command::initialise,      DeviceUp{Device::part_sensor}, DeviceUp{Device::strobe},
                               DeviceUp{Device::sensor}, DeviceUp{Device::rejector},    Command::arm,
                               Command::start_continuous};
        for (const Event& e : start) step(e);
        for (int k = 0; k < events && !::testing::Test::HasFailure(); ++k) {
            pass_time();
            step(any_event());
        }
        // Then no more events: every part must be completed by ticks alone.
        for (int k = 0; k < 100'000 && core_.line().size() > 0; ++k) {
            now_ = std::max(now_ + Duration(1), core_.next_wake());
            step(Tick{});
        }
        EXPECT_EQ(core_.line().size(), 0U);
        for (const auto& [number, part] : parts_) EXPECT_TRUE(part.recorded) << "part " << number << " has no verdict";
    }

    [[nodiscard]] const std::map<PartReason, int>& reasons() const { return reasons_; }
    [[nodiscard]] const std::map<RejectState, int>& outcomes() const { return outcomes_; }

  private:
    struct Shown {
        TimePoint arrived;
        bool exposed = false;
        TimePoint exposure_start, asked_at;
        bool own_frame = false, own_light = false, judged_pass = false;
        bool light_told = false, doubtful = false;
        bool commanded = false, recorded = false;
    };

    int pick(int n) { return static_cast<int>(random_() % static_cast<std::uint64_t>(n)); }
    bool chance(int percent) { return pick(100) < percent; }
    bool chance(int n, int of) { return pick(of) < n; }

    // Advances to `to` with every tick that the core requests; the belt moves most of the time.
    void pass_time() {
        const TimePoint to = now_ + microseconds(chance(90) ? pick(20'000) : pick(200'000));
        while (true) {
            const TimePoint due = std::min(core_.next_wake(), config_.by_encoder ? next_reading_ : TimePoint::max());
            if (due > to) break;
            now_ = std::max(now_, due);
            if (chance(2)) now_ += microseconds(pick(30'000));  // the loop was held up
            if (due == next_reading_) {
                counts_ += chance(98) ? 50 : pick(200);
                next_reading_ = now_ + milliseconds(5);
                step(hal::EncoderReading{now_, counts_});
            } else {
                step(Tick{});
            }
        }
        now_ = std::max(now_, to);
    }
    // The next command of a person who wants the station to run.
    Event recovery() {
        for (int d = 0; d < kDevices; ++d) {
            if (down_[d]) return up(static_cast<Device>(d));
        }
        switch (core_.state()) {
            case State::halted:
            case State::error: return Command::reset;
            case State::preoperational: return Command::initialise;
            case State::initialized: return Command::arm;
            default: return chance(90) ? Command::start_continuous : Command::start_single;
        }
    }
    Event up(Device device) {
        if (device == Device::part_sensor) edge_ = 0;
        return DeviceUp{device};
    }
    std::uint32_t any_part() {
        return number_ == 0 ? 1 : number_ - static_cast<std::uint32_t>(pick(static_cast<int>(std::min(number_, 5U))));
    }

    Event any_event() {
        if (plc_lost_ && chance(10)) return PlcBack{};
        if (!executing(core_.state()) && chance(60)) return recovery();
        if (last_commanded_ != 0 && chance(95)) {
            return hal::RejectReport{std::exchange(last_commanded_, 0U), hal::RejectReport::Outcome::confirmed, now_};
        }
        switch (pick(20)) {
            case 0:
            case 1:
            case 2:
            case 3: {
                hal::PartEdge edge;
                edge.sequence = chance(199, 200) ? ++edge_ : (edge_ += static_cast<std::uint32_t>(1 + pick(3)));
                edge.at = chance(98) ? now_ : now_ + microseconds(pick(40'000) - 20'000);
                if (config_.by_encoder && chance(97)) edge.counts = counts_;
                return edge;
            }
            case 4:
            case 5:
            case 6:
            case 7:
            case 8: {
                const std::uint32_t part = any_part();
                FrameArrived f{++handle_, {++frame_, parts_[part].exposure_start, 1000, false}};
                if (!parts_[part].exposed || chance(10)) f.info.exposure_start = now_ - microseconds(pick(100'000));
                if (chance(3)) f.info.sequence = frame_ -= static_cast<std::uint32_t>(pick(2));
                if (chance(3)) f.info.bytes_used = 999;
                if (chance(3)) f.info.corrupt = true;
                if (chance(40)) f.info.exposure = chance(90) ? part : any_part();
                else f.info.nobodys = chance(5);
                return f;
            }
            case 9:
            case 10:
            case 11:
            case 12: {
                const std::uint32_t part = any_part();
                const Shown& p = parts_[part];
                hal::StrobeReport r{part, chance(96), p.exposure_start + config_.strobe_delay, config_.strobe};
                if (chance(4)) r.start += microseconds(pick(1000) - 500);
                if (chance(4)) r.width += microseconds(pick(1000) - 500);
                return r;
            }
            case 13:
            case 14:
            case 15: {
                const int v = pick(4);
                return Judged{any_part(),
                              chance(2),
                              v >= 2       ? algo::Verdict::pass
                                  : v == 1 ? algo::Verdict::reject
                                           : algo::Verdict::unfit,
                              v >= 2       ? algo::Reason::none
                                  : v == 1 ? algo::Reason::deflection_gradient
                                           : algo::Reason::too_dark,
                              0,
                              0};
            }
            case 16:
            case 17: {
                using Outcome = hal::RejectReport::Outcome;
                return hal::RejectReport{any_part(),
                                         chance(95)       ? Outcome::confirmed
                                             : chance(50) ? Outcome::late
                                                          : Outcome::failed,
                                         now_};
            }
            case 18: {
                counts_ += pick(300);
                return hal::EncoderReading{now_, counts_};
            }
            default: return rare_event();
        }
    }
    Event rare_event() {
        switch (pick(12)) {
            case 0: return static_cast<Command>(pick(9) + 1);
            case 1: return DeviceLost{static_cast<Device>(pick(kDevices))};
            case 2: return up(static_cast<Device>(pick(kDevices)));
            case 3: return TriggerRefused{any_part()};
            case 4: return StrobeRefused{any_part()};
            case 5: return RejectRefused{any_part()};
            case 6: return InspectRefused{any_part()};
            case 7: return Judged{any_part(), true, algo::Verdict::pass, algo::Reason::none, 0, 0};
            case 8: return plc_lost_ || config_.plc_policy == PlcPolicy::none ? Event(PlcBack{}) : Event(PlcLost{});
            default: return Tick{};
        }
    }

    void step(const Event& event) {
        note(event);
        const bool was_stopped = core_.snapshot().line_stop;
        core_.step(event, now_, actions_);
        const bool left = std::holds_alternative<Command>(event) && std::get<Command>(event) == Command::reset;
        if (!std::holds_alternative<Tick>(event))
            reset_after_stop_ = left && was_stopped;  // a long line needs ticks until all its parts are completed
        if (was_stopped && !core_.line_stop()) stop_ended_at_ = now_;
        bool frame_given_back = false;
        for (const Action& action : actions_) check(action, event, frame_given_back);
        EXPECT_EQ(std::holds_alternative<FrameArrived>(event), frame_given_back)
            << "a frame is inspected or released, once";
        check_sums();
    }

    void note(const Event& event) {
        if (const auto* edge = std::get_if<hal::PartEdge>(&event)) {
            parts_[++number_].arrived = edge->at;
        } else if (const auto* report = std::get_if<hal::StrobeReport>(&event)) {
            Shown& p = parts_[report->exposure];
            const Duration off = report->start - (p.exposure_start + config_.strobe_delay);
            const Duration longer = report->width - config_.strobe;
            const bool good = report->lit && abs(off) <= config_.strobe_window && abs(longer) <= config_.strobe_window;
            if (p.exposed && !p.light_told) p.own_light = good;  // the first report is the one that counts
            p.light_told = p.light_told || p.exposed;
        } else if (const auto* judged = std::get_if<Judged>(&event)) {
            Shown& p = parts_[judged->part];
            if (p.own_frame && !judged->failed && judged->verdict == algo::Verdict::pass) p.judged_pass = true;
        }
        if (std::holds_alternative<PlcLost>(event)) plc_lost_ = true;
        if (std::holds_alternative<PlcBack>(event)) plc_lost_ = false;
        if (const auto* lost = std::get_if<DeviceLost>(&event)) down_[static_cast<int>(lost->device)] = true;
        if (const auto* back = std::get_if<DeviceUp>(&event)) down_[static_cast<int>(back->device)] = false;
        if (std::holds_alternative<Command>(event) && std::get<Command>(event) == Command::initialise &&
            core_.state() == State::preoperational) {
            for (bool& down : down_) down = true;  // the core opens all devices now
        }
        if (const auto* frame = std::get_if<FrameArrived>(&event)) {
            fresh_ = !frames_seen_ || static_cast<std::int32_t>(frame->info.sequence - highest_frame_) > 0;
            if (fresh_) highest_frame_ = frame->info.sequence;
            frames_seen_ = true;
            for (auto& [number, p] : parts_) {
                const bool in_window = p.exposed && frame->info.exposure_start >= p.asked_at &&
                    abs(frame->info.exposure_start - p.exposure_start) <= config_.frame_window;
                const bool named = frame->info.exposure == 0 || frame->info.exposure == number;
                if (fresh_ && !config_.by_encoder && p.own_frame && !p.recorded && in_window && named)
                    p.doubtful = true;
            }
        }
        const auto* up = std::get_if<DeviceUp>(&event);
        if (up != nullptr && up->device == Device::sensor) frames_seen_ = false;
    }
    static Duration abs(Duration d) { return d < Duration::zero() ? -d : d; }

    void check(const Action& action, const Event& event, bool& frame_given_back) {
        if (const auto* exposure = std::get_if<hal::ExposureRequest>(&action)) {
            Shown& p = parts_[exposure->exposure];
            EXPECT_FALSE(p.exposed);
            EXPECT_GE(exposure->start, now_);
            if (!config_.by_encoder) {
                EXPECT_EQ(exposure->start, p.arrived + config_.exposure_delay);
            }
            EXPECT_LE(exposure->start, now_ + config_.trigger_lead);
            p.exposed = true;
            p.exposure_start = exposure->start;
            p.asked_at = now_;
        } else if (const auto* inspect = std::get_if<Inspect>(&action)) {
            const auto* frame = std::get_if<FrameArrived>(&event);
            ASSERT_NE(frame, nullptr);
            EXPECT_EQ(frame->frame, inspect->frame);
            Shown& p = parts_[inspect->part];
            EXPECT_FALSE(p.own_frame) << "a second frame for part " << inspect->part;
            EXPECT_TRUE(fresh_ && !frame->info.corrupt && frame->info.bytes_used >= config_.frame_bytes);
            EXPECT_LE(abs(frame->info.exposure_start - p.exposure_start), config_.frame_window);
            EXPECT_GE(frame->info.exposure_start, p.asked_at);
            EXPECT_TRUE(frame->info.exposure == 0 || frame->info.exposure == inspect->part);
            EXPECT_FALSE(frame->info.nobodys);
            p.own_frame = true;
            EXPECT_FALSE(std::exchange(frame_given_back, true));
        } else if (const auto* release = std::get_if<ReleaseFrame>(&action)) {
            const auto* frame = std::get_if<FrameArrived>(&event);
            ASSERT_NE(frame, nullptr);
            EXPECT_EQ(frame->frame, release->frame);
            EXPECT_FALSE(std::exchange(frame_given_back, true));
        } else if (const auto* command = std::get_if<hal::RejectCommand>(&action)) {
            Shown& p = parts_[command->part];
            EXPECT_FALSE(p.commanded) << "commanded twice";
            EXPECT_FALSE(p.recorded) << "commanded after its story was complete";
            EXPECT_LT(now_, command->start + command->width) << "the pulse would hit a neighbour";
            p.commanded = true;
            last_commanded_ = command->part;
        } else if (const auto* result = std::get_if<PartResult>(&action)) {
            check(*result);
        }
    }

    void check(const PartResult& r) {
        ASSERT_TRUE(r.part >= 1 && r.part <= number_);
        Shown& p = parts_[r.part];
        EXPECT_FALSE(p.recorded) << "part " << r.part << " has two verdicts";
        EXPECT_EQ(r.sequence, ++results_);
        p.recorded = true;
        ++reasons_[r.reason];
        ++outcomes_[r.reject];
        if (r.verdict == PartVerdict::pass) {
            EXPECT_TRUE(p.own_frame && p.own_light && p.judged_pass)
                << "part " << r.part << " passed without valid data of its own";
            EXPECT_FALSE(p.doubtful) << "part " << r.part << " passed, and two frames were in its window";
            EXPECT_FALSE(p.commanded);
            EXPECT_FALSE(plc_lost_ && config_.plc_policy == PlcPolicy::reject_all) << "passed without the PLC";
            EXPECT_EQ(r.reject, RejectState::not_needed);
            EXPECT_EQ(r.reason, PartReason::none);
            if (!config_.by_encoder) {
                EXPECT_LT(now_, p.arrived + kDeadline) << "a late verdict was accepted";
            }
        } else {
            EXPECT_NE(r.reason, PartReason::none);
            const bool taken_off = !config_.by_encoder && p.arrived < stop_ended_at_;
            EXPECT_TRUE(r.reject == RejectState::confirmed || core_.line_stop() || reset_after_stop_ || taken_off)
                << "unconfirmed, and the line runs";
            EXPECT_TRUE(p.commanded || r.reject != RejectState::confirmed);
        }
    }

    void check_sums() {
        std::uint32_t waiting = 0, decided = 0, commanded = 0;
        for (std::uint32_t k = 0; k < core_.line().size(); ++k) {
            const Part::Phase phase = core_.line()[k].phase;
            waiting += phase == Part::Phase::waiting ? 1U : 0U;
            decided += phase == Part::Phase::decided ? 1U : 0U;
            commanded += phase == Part::Phase::commanded ? 1U : 0U;
        }
        const Snapshot s = core_.snapshot();
        const Counters& c = s.counters;
        EXPECT_EQ(c.seen, number_);
        EXPECT_EQ(c.seen, c.pass + c.reject + c.unfit + waiting);
        EXPECT_EQ(c.reject + c.unfit, c.reject_commanded + decided);
        EXPECT_EQ(c.reject_commanded, c.reject_confirmed + c.reject_failed + c.reject_late + commanded);
        EXPECT_GE(c.inspected, c.pass + c.reject);
        EXPECT_LE(c.inspected, c.pass + c.reject + c.unfit);
        EXPECT_EQ(results_, c.pass + c.reject_confirmed + c.reject_failed + c.reject_late);
        if (s.run_permit) {
            EXPECT_TRUE((executing(s.state) || s.state == State::ready) && !s.line_stop);
        }
        EXPECT_EQ(s.first_fault == 0, s.faults_latched == 0);
        if (s.first_fault != 0) {
            EXPECT_NE(s.faults_latched & (1U << (s.first_fault - 1)), 0U);
        }
    }

    CoreConfig config_;
    Core core_;
    Actions actions_;
    std::mt19937_64 random_;
    TimePoint now_{std::chrono::seconds(10)};
    std::uint32_t edge_ = 0, frame_ = 7, handle_ = 0, number_ = 0, results_ = 0, last_commanded_ = 0;
    std::int64_t counts_ = 0;
    bool fresh_ = false, frames_seen_ = false, reset_after_stop_ = false;
    TimePoint stop_ended_at_ = TimePoint::min();
    std::uint32_t highest_frame_ = 0;
    bool plc_lost_ = false;
    bool down_[kDevices] = {};
    TimePoint next_reading_{};
    std::map<std::uint32_t, Shown> parts_;
    std::map<PartReason, int> reasons_;
    std::map<RejectState, int> outcomes_;
};

void run_seeds(const CoreConfig& config, std::uint64_t from) {
    std::map<PartReason, int> reasons;
    std::map<RejectState, int> outcomes;
    for (std::uint64_t seed = from; seed < from + 150; ++seed) {
        SCOPED_TRACE("seed " + std::to_string(seed));
        Shadow shadow(seed, config);
        shadow.run(2000);
        if (::testing::Test::HasFailure()) return;
        for (const auto& [reason, n] : shadow.reasons()) reasons[reason] += n;
        for (const auto& [outcome, n] : shadow.outcomes()) outcomes[outcome] += n;
    }
    // Coverage: every reason and every outcome must have occurred.
    for (const PartReason reason :
         {PartReason::none, PartReason::deflection_gradient, PartReason::too_dark, PartReason::verdict_late,
          PartReason::frame_lost, PartReason::frame_stale, PartReason::frame_duplicate, PartReason::frame_short,
          PartReason::frame_corrupt, PartReason::strobe_failed, PartReason::parts_too_close,
          PartReason::station_not_running, PartReason::device_lost, PartReason::edge_lost,
          PartReason::inspector_failed}) {
        if (config.by_encoder && reason == PartReason::verdict_late) continue;
        EXPECT_GT(reasons[reason], 0) << name_of(reason) << " never happened";
    }
    EXPECT_EQ(reasons[PartReason::plc_lost] > 0, config.plc_policy == PlcPolicy::reject_all);
    for (const RejectState outcome :
         {RejectState::not_needed, RejectState::confirmed, RejectState::failed, RejectState::late}) {
        EXPECT_GT(outcomes[outcome], 0) << static_cast<int>(outcome) << " never happened";
    }
}

TEST(CoreProperties, hold_for_any_events_on_a_timed_line) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 20;
    run_seeds(config, 1);
}

TEST(CoreProperties, hold_for_any_events_on_a_line_whose_plc_comes_and_goes) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 20;
    config.plc_policy = PlcPolicy::reject_all;
    run_seeds(config, 2000);
    config.plc_policy = PlcPolicy::stop;
    run_seeds(config, 3000);
}

TEST(CoreProperties, hold_for_any_events_on_a_line_with_encoder) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 20;
    config.by_encoder = true;
    config.encoder_timeout = std::chrono::seconds(2);
    run_seeds(config, 1000);
}

}  // namespace
}  // namespace hord::firmware
