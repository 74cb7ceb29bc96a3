// Everything below the seam, chosen by the configuration: the one place that names a backend.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "algo/frame/extents.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// How the simulated part of the cell behaves. The simulated line follows the configuration's timing.
struct SimulationOptions {
    std::uint64_t seed = 1;
    std::uint64_t parts = 0;  // how many come; 0: no end (recorded frames: as many as there are)
    double parts_per_second = 10;
    double good_share = 0.7;
    int variety = 4;                       // different parts of each kind; each is rendered once, at the start
    std::filesystem::path cache;           // folder where what was rendered is kept for the next start; empty: nowhere
    bool own_coil_module = false;          // a Modbus coil module on loopback, which moves the simulated ejector
    int realtime = 0;                      // its real-time priority; 0: none
    std::function<void(double)> progress;  // of rendering the parts, 0..1
};

class Backends {
  public:
    // Fails as the devices' own open() do, and with what rendering says. `loop` outlives it.
    static Result<std::unique_ptr<Backends>> open(hal::EventLoop& loop, const Config& config,
                                                  const SimulationOptions& options);
    virtual ~Backends() = default;

    // What the rejector's module says it is, and how its outputs stand; moves nothing, may block for a few time-outs.
    // Fails as its link does, with unsupported where the rejector is no module.
    [[nodiscard]] virtual Result<std::string> ask_module() = 0;

    [[nodiscard]] virtual hal::PartSensor& part_sensor() = 0;
    [[nodiscard]] virtual hal::Strobe& strobe() = 0;
    [[nodiscard]] virtual hal::Sensor& sensor() = 0;
    [[nodiscard]] virtual hal::Rejector& rejector() = 0;

    // Simulated line: the belt moves from now on; harmless when it moves, and on a real line.
    virtual void start_line() = 0;
    // Simulated line: parts are put on it, or no more, as a PLC does while the station executes.
    virtual void feed_line(bool on) = 0;
    // Simulated line: somebody takes every part off it.
    virtual void clear_line() = 0;

    // What truly became of a part of the simulated line; told on the loop's thread.
    struct Fate {
        hal::TimePoint arrived;  // equals the part's edge
        std::string kind;        // "good", "bubble", ...; empty where nobody knows (recorded frames)
        bool ejected = false;
        bool taken_off = false;  // by clear_line()
    };
    // `over`: the simulated line has brought its last part, which has left. A real line never ends.
    virtual void watch_line(std::function<void(const Fate&)> fate, std::function<void()> over) = 0;
};

}  // namespace hord::firmware
