// Creates the devices that the configuration names, real or simulated.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/part_sensor.h"
#include "drivers/hal/rejector.h"
#include "drivers/hal/sensor.h"
#include "drivers/hal/strobe.h"
#include "firmware/config/config.h"

namespace hord::firmware {

// The simulated part of the cell. The simulated line follows the configuration's timing.
struct SimulationOptions {
    std::uint64_t seed = 1;
    std::uint64_t parts = 0;      // 0: no end; recorded frames: at most one for each frame
    double parts_per_second = 0;  // 0: one part each two configured minimum gaps, at most 10
    double good_share = 0.7;
    int variety = 4;                       // different parts of each kind, rendered at the start
    bool all_defects = false;              // all kinds of hal_sim/cell/production.h, else its kLightTakers
    std::filesystem::path cache;           // folder that keeps rendered parts for the next start; empty: none
    bool own_coil_module = false;          // a Modbus coil module on loopback moves the simulated ejector
    int realtime = 0;                      // the coil module's real-time priority; 0: none
    std::function<void(double)> progress;  // of rendering the parts or reading the recorded frames, 0..1
};

// Parts a second of the simulated line; `wanted` is SimulationOptions::parts_per_second.
double rate_of_line(const CoreConfig& core, double wanted);

// The fault bits of the devices that are simulated, or play recorded frames.
std::uint32_t simulated_devices(const Config& config, const SimulationOptions& simulation);

// Each opens the configured real device. Returns null if it is simulated; fails as the driver's open() does.
Result<std::unique_ptr<hal::Strobe>> open_strobe(hal::EventLoop& loop, const Config& config);
// The light that the sensor's camera drives itself; null where the configuration has none. `sensor` outlives it.
std::unique_ptr<hal::Strobe> light_of_camera(hal::EventLoop& loop, const Config& config, hal::Sensor* sensor);
// The same of a light barrier on the camera's input.
std::unique_ptr<hal::PartSensor> barrier_of_camera(hal::EventLoop& loop, const Config& config, hal::Sensor* sensor);
Result<std::unique_ptr<hal::PartSensor>> open_part_sensor(hal::EventLoop& loop, const Config& config);
// `progress`: of reading recorded frames, 0..1.
Result<std::unique_ptr<hal::Sensor>> open_sensor(hal::EventLoop& loop, const Config& config,
                                                 const std::function<void(double)>& progress = {});

// Reads the name of the rejector's module and the state of its outputs. Changes nothing; blocks for up to a
// few response time-outs. Fails as the link to the module does.
Result<std::string> describe_module(const hal::Clock& clock, const drivers::ModbusRejectorOptions& options);

struct ModuleIdentity {
    std::string text;     // what it says it is; empty: nothing
    std::string profile;  // rejector.profile that fits; empty: not known
    int first_output = 0;
};
// Asks the module at an address what it is, by device identification and by the name registers of the known profiles.
// Reads alone; blocks for some `patience`. Fails as the link to the module does.
Result<ModuleIdentity> identify_module(const hal::Clock& clock, const drivers::ModuleAddress& address,
                                       hal::Duration patience);

class Backends {
  public:
    // Fails as the devices' open() and the rendering do. `loop` must outlive the devices.
    static Result<std::unique_ptr<Backends>> open(hal::EventLoop& loop, const Config& config,
                                                  const SimulationOptions& options);
    virtual ~Backends() = default;

    // See describe_module(). Fails with unsupported if the rejector has no module.
    [[nodiscard]] virtual Result<std::string> describe_module() = 0;

    [[nodiscard]] virtual hal::PartSensor& part_sensor() = 0;
    [[nodiscard]] virtual hal::Strobe& strobe() = 0;
    [[nodiscard]] virtual hal::Sensor& sensor() = 0;
    [[nodiscard]] virtual hal::Rejector& rejector() = 0;

    // Starts the simulated line's belt: with a simulated rejector it moves while the rejector has the run permit, else
    // from now on. No effect when it has been started, or on a real line.
    virtual void start_line() = 0;
    // Simulated line: starts or stops putting parts on it, as a PLC does while the station executes.
    virtual void feed_line(bool on) = 0;
    // Simulated line: removes all parts.
    virtual void clear_line() = 0;

    // Ground truth of a part of the simulated line.
    struct Fate {
        hal::TimePoint arrived;       // equals the part's edge
        std::string kind;             // "good", "bubble", ...; empty for recorded frames
        std::size_t look = 0;         // which of the rendered parts it is
        std::optional<bool> ejected;  // nothing: the rejector is real, so the simulated line does not see it
        bool taken_off = false;       // by clear_line()
        bool on_line = false;         // still, when the station ended: what it would have been is not known
    };
    // Both are called on the loop's thread. `over`: the simulated line's last part has left. A real line never ends.
    virtual void watch_line(std::function<void(const Fate&)> fate, std::function<void()> over) = 0;

    // What an ordinary inspection camera would have seen of a part of the simulated line: telecentric, along the axis,
    // before a wide panel of light (sim::TelecentricCamera), without noise. One pixel a lenslet, row by row; 1: all
    // light comes from the panel. Rendered at each call, within some ten milliseconds; any thread. Fails with
    // unsupported for parts that are not rendered.
    [[nodiscard]] virtual Result<std::vector<float>> telecentric_view(std::size_t look) const = 0;
};

}  // namespace hord::firmware
