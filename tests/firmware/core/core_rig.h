// Drives a Core by hand: a clock and devices controlled by the test, and a record of every action.
#pragma once

#include <vector>

#include <gtest/gtest.h>

#include "firmware/core/core.h"

namespace hord::firmware {

// One part every 100 ms at most, a verdict due 155 ms after the edge, the ejector at 180 ms.
inline CoreConfig quick_line() {
    CoreConfig c;
    c.transport = milliseconds(180);
    c.transport_counts = 1800;
    c.exposure_delay = milliseconds(5);
    c.frame_timeout = milliseconds(50);
    c.frame_bytes = 1000;
    c.station_heartbeat = std::chrono::hours(1);
    return c;
}
constexpr Duration kDeadline = milliseconds(180 - 5 - 20);  // of quick_line(), from the edge
constexpr Duration kPulseStart = milliseconds(175);
constexpr Duration kPulseEnd = milliseconds(190);

class CoreRig {
  public:
    explicit CoreRig(const CoreConfig& config = quick_line()) : core(config) {
        EXPECT_TRUE(problems(config).empty()) << problems(config).front();
    }

    Answer send(const Event& event) {
        const Answer answer = core.step(event, now, actions);
        collect();
        while (core.next_wake() <= now) {  // work that the step deferred
            core.step(Tick{}, now, actions);
            collect();
        }
        return answer;
    }
    // Advances time with every tick that the core requests.
    void advance(Duration by) {
        const TimePoint end = now + by;
        while (core.next_wake() <= end) {
            now = std::max(now, core.next_wake());
            send(Tick{});
        }
        now = end;
    }

    void devices_up() {
        for (int d = 0; d < kDevices; ++d) send(DeviceUp{static_cast<Device>(d)});
    }
    // Sends the shortest sequence of commands to `state`; each command must be accepted.
    void bring_to(State state) {
        const auto command = [&](Command c) { ASSERT_EQ(send(c), Answer::done); };
        if (state == State::preoperational) return;
        if (state == State::halted) return command(Command::halt);
        command(Command::initialise);
        devices_up();
        if (state == State::initialized) return;
        command(Command::arm);
        if (state == State::ready) return;
        command(state == State::single_execution ? Command::start_single : Command::start_continuous);
        if (state == State::error) {
            send(DeviceLost{Device::sensor});
            send(DeviceUp{Device::sensor});
        }
        ASSERT_EQ(core.state(), state);
        forget();
    }

    // A part arrives now. Returns its number: parts are numbered from 1, with one edge a part unless a test sends more.
    std::uint32_t part_arrives() {
        hal::PartEdge edge;
        edge.at = now;
        edge.sequence = ++edges;
        if (core.config().by_encoder) edge.counts = counts;
        send(edge);
        return core.snapshot().counters.seen;
    }
    void belt(std::int64_t by) {
        counts += by;
        send(hal::EncoderReading{now, counts});
    }
    [[nodiscard]] hal::ExposureRequest exposure_of(std::uint32_t part) const {
        for (const auto& e : exposures) {
            if (e.exposure == part) return e;
        }
        ADD_FAILURE() << "part " << part << " was not exposed";
        return {};
    }
    void light_comes(std::uint32_t part) {
        const auto& c = core.config();
        send(hal::StrobeReport{part, true, exposure_of(part).start + c.strobe_delay, c.strobe});
    }
    void frame_comes(std::uint32_t part) { frame_comes_at(exposure_of(part).start); }
    void frame_comes_at(TimePoint exposure_start) {
        send(FrameArrived{++frames, {++frame_sequence, exposure_start, 1000, false}});
    }
    void judged(std::uint32_t part, algo::Verdict verdict, algo::Reason reason = algo::Reason::none) {
        send(Judged{part, false, verdict, reason, static_cast<std::uint16_t>(verdict == algo::Verdict::pass ? 0 : 2),
                    1.5F});
    }
    void confirmed(std::uint32_t part) { send(hal::RejectReport{part, hal::RejectReport::Outcome::confirmed, now}); }
    // A part arrives and is exposed; its light and frame are reported 10 ms after the edge.
    std::uint32_t part_is_seen() {
        const std::uint32_t part = part_arrives();
        advance(milliseconds(10));
        light_comes(part);
        frame_comes(part);
        return part;
    }

    // Advances until the part's reject command; false if there is none within `limit`.
    bool advance_until_rejected(std::uint32_t part, Duration limit = milliseconds(200)) {
        for (const TimePoint end = now + limit; now < end && !rejected(part);) advance(milliseconds(1));
        return rejected(part);
    }
    [[nodiscard]] Snapshot shot() const { return core.snapshot(); }
    [[nodiscard]] const PartResult& only_result() const {
        static const PartResult none;
        EXPECT_EQ(results.size(), 1U);
        return results.size() == 1 ? results.front() : none;
    }
    [[nodiscard]] bool rejected(std::uint32_t part) const {
        for (const auto& r : rejects) {
            if (r.part == part) return true;
        }
        return false;
    }
    void forget() {
        results.clear();
        rejects.clear();
        exposures.clear();
        pulses.clear();
        inspections.clear();
        released.clear();
        permits.clear();
        starts.clear();
        stops = 0;
    }

    Core core;
    Actions actions;
    TimePoint now{std::chrono::seconds(100)};
    std::uint32_t edges = 0;
    std::uint32_t frames = 0;           // handles
    std::uint32_t frame_sequence = 40;  // the device's own count starts anywhere
    std::int64_t counts = 7000;

    std::vector<PartResult> results;
    std::vector<hal::RejectCommand> rejects;
    std::vector<hal::ExposureRequest> exposures;
    std::vector<hal::StrobePulse> pulses;
    std::vector<Inspect> inspections;
    std::vector<FrameHandle> released;
    std::vector<bool> permits;
    std::vector<Device> starts;
    int stops = 0;

  private:
    void collect() {
        for (const Action& action : actions) {
            if (const auto* a = std::get_if<PartResult>(&action)) results.push_back(*a);
            else if (const auto* b = std::get_if<hal::RejectCommand>(&action)) rejects.push_back(*b);
            else if (const auto* c = std::get_if<hal::ExposureRequest>(&action)) exposures.push_back(*c);
            else if (const auto* d = std::get_if<hal::StrobePulse>(&action)) pulses.push_back(*d);
            else if (const auto* e = std::get_if<Inspect>(&action)) inspections.push_back(*e);
            else if (const auto* f = std::get_if<ReleaseFrame>(&action)) released.push_back(f->frame);
            else if (const auto* g = std::get_if<SetRunPermit>(&action)) permits.push_back(g->permit);
            else if (const auto* h = std::get_if<StartDevice>(&action)) starts.push_back(h->device);
            else if (std::get_if<StopDevices>(&action) != nullptr) ++stops;
            else ADD_FAILURE() << "an empty action";
        }
    }
};

}  // namespace hord::firmware
