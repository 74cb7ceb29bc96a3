// Options of the strobe behind a Gardasoft RT controller, and the limits that its manual gives for a pulse. The
// configuration reads them from [strobe]; deploy/hordd.toml documents the keys.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "drivers/hal/clock.h"
#include "drivers/hal/light_budget.h"

namespace hord::drivers {

struct GardasoftChannel {
    int output = 1;                   // of the controller, 1..8
    int rated_ma = 0;                 // what the light's label says, 10..3000
    double brightness_percent = 100;  // of rated_ma, 1..999 in steps of 0.1
    int max_ma = 0;                   // largest current of a pulse; 0: rated_ma
    hal::LightLimits limits;
    bool operator==(const GardasoftChannel&) const = default;

    [[nodiscard]] double pulse_ma() const { return rated_ma * brightness_percent / 100; }
};

struct GardasoftStrobeOptions {
    std::string host;    // of the models with Ethernet (RT220, RT420, RT820)
    int port = 30313;    // 1..65535
    std::string device;  // a serial line, 115200 baud, instead of host and port (RT260, RT460, RT860)
    std::vector<GardasoftChannel> channels;
    hal::Duration pulse = std::chrono::microseconds(200);  // timing.strobe_us: 20 us..999 ms, whole microseconds
    hal::Duration delay = std::chrono::microseconds(20);   // from the trigger to the light: 20 us..999 ms, the same
    hal::Duration response_timeout = std::chrono::milliseconds(100);
    bool operator==(const GardasoftStrobeOptions&) const = default;
};

inline constexpr hal::Duration kGardasoftShortest = std::chrono::microseconds(20);
inline constexpr hal::Duration kGardasoftLongest = std::chrono::milliseconds(999);

// Why the controller's manual forbids pulses of this length and brightness, or the channel's own max_ma does; empty: it
// is allowed. Key and sentence, so that the configuration can point at the line.
struct GardasoftProblem {
    std::string key, what, cure;
};
inline GardasoftProblem problem_of(const GardasoftChannel& channel, hal::Duration pulse) {
    using namespace std::chrono_literals;
    struct Overdrive {
        double percent;
        hal::Duration longest;
        double duty;
    };
    // "Pulsed output": the operating limits of an overdriven light.
    static constexpr std::array<Overdrive, 5> kOverdrive = {
        {{100, kGardasoftLongest, 1}, {200, 30ms, 0.3}, {300, 10ms, 0.2}, {500, 2ms, 0.1}, {1000, 1ms, 0.05}}};
    struct Current {
        double ma;
        hal::Duration longest;
    };
    // Appendix "Pulse mode": a pulse of this current or less.
    static constexpr std::array<Current, 5> kCurrents = {
        {{5'000, kGardasoftLongest}, {10'000, 3ms}, {12'000, 1ms}, {20'000, 400us}, {20'000.5, 100us}}};
    const double ma = channel.pulse_ma();
    const int most = channel.max_ma > 0 ? channel.max_ma : channel.rated_ma;
    if (ma > most)
        return {"brightness_percent", "gives " + std::to_string(static_cast<int>(ma)) + " mA, above max_ma",
                "lower it; max_ma protects the LED"};
    for (const Overdrive& row : kOverdrive) {
        if (channel.brightness_percent > row.percent) continue;
        if (pulse > row.longest)
            return {"brightness_percent", "is too high for pulses of timing.strobe_us",
                    "the controller allows 200 % up to 30 ms, 300 % to 10 ms, 500 % to 2 ms, above that 1 ms"};
        if (channel.limits.max_duty > row.duty)
            return {"max_duty", "is above what the controller allows at this brightness",
                    "it allows 0.3 up to 200 %, 0.2 to 300 %, 0.1 to 500 %, above that 0.05"};
        break;
    }
    for (const Current& row : kCurrents) {
        if (ma >= row.ma) continue;
        if (pulse > row.longest)
            return {"brightness_percent", "asks for a current that the controller does not hold for timing.strobe_us",
                    "the controller allows 5 A for 3 ms, 10 A for 1 ms, 12 A for 0.4 ms, 20 A for 0.1 ms"};
        break;
    }
    if (ma > 20'000) return {"brightness_percent", "asks for more than 20 A", "lower it"};
    const double short_duty = ma > 500 ? 0.01 : 0.1;
    if (pulse < 70us && channel.limits.max_duty > short_duty)
        return {"max_duty", "is above what the controller allows for pulses below 70 us",
                "it allows 0.01 above 500 mA, else 0.1: it cannot measure so short a pulse"};
    return {};
}

}  // namespace hord::drivers
