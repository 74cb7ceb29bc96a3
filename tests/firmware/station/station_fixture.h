// A station in virtual time, with devices controlled by the test.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/station/station.h"
#include "lab/stand_in/stand_in_inspector.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/station/fake_devices.h"

namespace hord::firmware {

struct Observer final : StationObserver {
    std::vector<PartResult> results;
    std::vector<State> states;
    std::vector<Error> troubles;
    std::vector<std::pair<std::uint32_t, std::string>> faults;  // raised, and why the line is stopped
    std::vector<FrameHandle> frames;                            // that the core was told of
    void on_step(State, const Event& event) override {
        if (const auto* frame = std::get_if<FrameArrived>(&event)) frames.push_back(frame->frame);
    }
    void on_result(const PartResult& result) override { results.push_back(result); }
    void on_fault(std::uint32_t raised, const Snapshot& now) override {
        faults.emplace_back(raised, text_of(now.line_stop_why));
    }
    void on_state(State, State to) override { states.push_back(to); }
    void on_trouble(const Error& error) override { troubles.push_back(error); }
};

class StationTest : public ::testing::Test {
  protected:
    StationTest() {
        // Good light and a pass 20 ms after the frame, unless a test says otherwise.
        inspector =
            lab::make_stand_in_inspector(loop, 2, [this](std::uint32_t, const hal::FrameLease&) { return answer; });
        station.emplace(CoreConfig{}, Cell{loop, part_sensor, strobe, sensor, rejector, *inspector}, &observer);
    }
    void run() {
        station->run();
        rejector.link(true);
        ASSERT_EQ(station->snapshot().state, State::continuous_execution);
    }
    void part() { part_sensor.listener->on_edge({hal::PartEdge::Kind::arrives, loop.now(), ++edges, {}}); }
    void light_and_frame() {
        const auto& pulse = strobe.pulses.back();
        strobe.listener->on_strobe({pulse.exposure, true, pulse.start, pulse.width});
        sensor.deliver(sensor.requests.back().start);
    }

    lab::VirtualTime loop;
    FakePartSensor part_sensor;
    FakeStrobe strobe;
    FakeSensor sensor;
    FakeRejector rejector;
    lab::StandInAnswer answer{Judged{0, false, algo::Verdict::pass, algo::Reason::none, 0, 0.5F}, milliseconds(20)};
    std::unique_ptr<Inspector> inspector;
    Observer observer;
    std::optional<Station> station;
    std::uint32_t edges = 0;
};

}  // namespace hord::firmware
