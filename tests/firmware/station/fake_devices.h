// Devices controlled by the test: they record calls, and report when the test says so.
#pragma once

#include <array>
#include <vector>

#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"

namespace hord::firmware {

struct FakePartSensor final : hal::PartSensor {
    Listener* listener = nullptr;
    int starts = 0;
    bool absent = false;

    Result<void> do_start(Listener& l) override {
        ++starts;
        if (absent) return fail(ErrorCode::not_found, "line 4 of gpiochip0", "name a line that exists");
        listener = &l;
        return {};
    }
    void do_stop() override { listener = nullptr; }
};

struct FakeStrobe final : hal::Strobe {
    Listener* listener = nullptr;
    std::vector<hal::StrobePulse> pulses;
    bool hot = false;

    Result<void> do_start(Listener& l) override {
        listener = &l;
        return {};
    }
    Result<void> do_fire(const hal::StrobePulse& pulse) override {
        if (hot) return fail(ErrorCode::refused, "the light has not rested", "space the parts");
        pulses.push_back(pulse);
        return {};
    }
    void do_stop() override { listener = nullptr; }
    hal::StrobeLimits limits() const override {
        return {std::chrono::milliseconds(2), std::chrono::milliseconds(5), 1};
    }
};

struct FakeSensor final : hal::Sensor {
    Listener* listener = nullptr;
    std::vector<hal::ExposureRequest> requests;
    std::uint32_t sequence = 0;
    int given_back = 0;
    bool no_buffer = false;
    std::array<std::byte, 64> samples{};

    hal::SensorFormat shape{8, 8, 8, 4};

    hal::SensorFormat format() const override { return shape; }
    Result<void> do_start(Listener& l) override {
        listener = &l;
        return {};
    }
    Result<void> do_trigger(const hal::ExposureRequest& request) override {
        if (no_buffer) return fail(ErrorCode::busy, "no free buffer", "inspect faster");
        requests.push_back(request);
        return {};
    }
    void do_stop() override { listener = nullptr; }
    void do_give_back(std::uint32_t) noexcept override { ++given_back; }

    void deliver(hal::TimePoint exposure_start, std::size_t bytes = 64, bool corrupt = false) {
        listener->on_frame(hal::FrameLease(*this, sequence % 4, {samples.data(), 8, 8, 8, 8},
                                           {++sequence, exposure_start, bytes, corrupt}));
    }
};

struct FakeRejector final : hal::Rejector {
    Listener* listener = nullptr;
    std::vector<hal::RejectCommand> commands;
    std::vector<bool> permits;
    int starts = 0, stops = 0;
    bool full = false;

    Result<void> do_start(Listener& l) override {
        ++starts;
        listener = &l;
        return {};
    }
    Result<void> do_reject(const hal::RejectCommand& command) override {
        if (full) return fail(ErrorCode::busy, "the rejector's queue is full", "space the parts");
        commands.push_back(command);
        return {};
    }
    void do_set_run_permit(bool permit) override { permits.push_back(permit); }
    void do_stop() override {
        ++stops;
        listener = nullptr;
    }
    void link(bool up) {
        listener->on_rejector_link(
            up, up ? Error{} : Error{ErrorCode::disconnected, "module at 10.0.0.7", "check its cable"});
    }
};

}  // namespace hord::firmware
