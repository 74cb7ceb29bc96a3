// A whole station, assembled from its configuration and run on the event loop: what hordd does at boot and
// `hordctl run` does in the foreground.
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

// Told on the loop's thread (on_inspection: on the thread that inspects). All may be left empty.
struct ServiceWatchers {
    std::function<void(const PartResult&)> result;  // a part's story is complete
    std::function<void(State from, State to)> state;
    std::function<void(const NumberedRecipe&)> recipe;  // in use from now on; not told of the first
    std::function<void()> reload;                       // SIGHUP; without it the signal is not touched
    std::function<void(const Error&)> trouble;          // to be logged, once, with its cure
    std::function<void(const Backends::Fate&)> fate;    // simulated line: what truly became of a part
    std::function<void()> line_over;  // simulated line: all parts came and left; their results may still come
    std::function<void(std::uint32_t part, const FrameView&, const algo::Inspection&)> inspection;
};

// Listening sockets that somebody else has opened, as systemd does for port 502; -1: the service opens its own. Taken
// over.
struct ListenSockets {
    int modbus = -1, modbus_read_only = -1;
};

class Service {
  public:
    // Opens everything and takes the register port; nothing runs yet. Fails with every device's and port's own error.
    static Result<std::unique_ptr<Service>> open(const Config& config, const SimulationOptions& simulation,
                                                 ServiceWatchers watchers, const ListenSockets& doors = {});
    ~Service();  // halts: lights off, outputs safe

    // Runs until stop(), or SIGINT or SIGTERM. The simulated line starts when the station executes, or after
    // `kLineWaits` whatever the station does: parts do not ask.
    Result<void> run();
    static constexpr Duration kLineWaits = milliseconds(3000);

    void stop();  // any thread

    // Loop thread. Another configuration without stopping: who may connect and write, the PLC's timeout, the folder of
    // recipes, and, while the station does not execute, the recipe. Returns what else differs and needs a restart, by
    // table of the file. Fails with what is wrong with the new recipe; then nothing has changed.
    Result<std::vector<std::string>> reload(const Config& config);

    // Loop thread, simulated line only. What a person does at a line that was stopped: takes the parts off it and
    // resets the station, which then goes on as it was told to before.
    void look_after_line();

    // Loop thread. Calls `all_here` on it once every inspecting thread has taken a turn; never when one hangs.
    void liveness_check(std::function<void()> all_here);

    [[nodiscard]] SdEventLoop& loop();
    [[nodiscard]] Backends& backends();
    [[nodiscard]] Snapshot snapshot() const;              // loop thread
    [[nodiscard]] std::string registers_address() const;  // "127.0.0.1:1502"

  private:
    struct Components;
    explicit Service(std::unique_ptr<Components> parts);
    std::unique_ptr<Components> parts_;
};

}  // namespace hord::firmware
