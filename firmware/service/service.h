// A whole station, built from its configuration and run on the event loop, for hordd and `hordctl run`.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/config/config.h"
#include "firmware/core/station_types.h"
#include "firmware/devices/device_factory.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/station/inspector.h"
#include "firmware/station/station.h"

namespace hord::firmware {

// Called on the loop's thread (inspection: on the inspecting threads). All are optional.
struct ServiceWatchers {
    std::function<void(const PartResult&)> result;  // a part's final result
    std::function<void(State from, State to)> state;
    std::function<void(const NumberedRecipe&)> recipe;  // another recipe is in use; not called for the first one
    std::function<void()> reload;                       // SIGHUP; empty: the signal is not handled
    std::function<void(const Error&)> trouble;          // to be logged once
    std::function<void(const Backends::Fate&)> fate;    // simulated line: where a part really went
    std::function<void()> line_over;  // simulated line: all parts came and left; their results may still come
    std::function<void(std::uint32_t part, const FrameView&, const algo::Inspection&)> inspection;
};

// Open listening sockets (systemd's socket activation); the service takes ownership. -1: it opens its own.
struct ListenSockets {
    int modbus = -1, modbus_read_only = -1;
};

class Service {
  public:
    // Opens devices and ports; nothing runs yet. Fails as the devices and servers do.
    static Result<std::unique_ptr<Service>> open(const Config& config, const SimulationOptions& simulation,
                                                 ServiceWatchers watchers, const ListenSockets& sockets = {});
    ~Service();  // halts: lights off, outputs safe

    // Runs until stop(), SIGINT or SIGTERM. The simulated line starts when the station executes, and after `kLineWaits`
    // in any state.
    Result<void> run();
    static constexpr Duration kLineWaits = milliseconds(3000);

    void stop();  // any thread

    // Loop thread. Applies another configuration at run time: access rules, the PLC's timeout, the folder of recipes,
    // and, while the station does not execute, the recipe. Returns the differing tables and keys that need a restart.
    // Fails if the new recipe cannot be used; then nothing has changed.
    Result<std::vector<std::string>> reload(const Config& config);

    // Loop thread, simulated line only. Acts as a person at a stopped line: removes the parts and resets the station.
    void look_after_line();

    // Loop thread. Calls `all_here` there once every inspecting thread has answered; never if one hangs.
    void liveness_check(std::function<void()> all_here);

    [[nodiscard]] SdEventLoop& loop();
    [[nodiscard]] Backends& backends();
    [[nodiscard]] Snapshot snapshot() const;              // loop thread
    [[nodiscard]] std::string registers_address() const;  // "127.0.0.1:1502"

  private:
    struct Components;
    explicit Service(std::unique_ptr<Components> components);
    std::unique_ptr<Components> components_;
};

}  // namespace hord::firmware
