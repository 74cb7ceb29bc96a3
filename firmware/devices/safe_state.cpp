#include "firmware/devices/safe_state.h"

#include <variant>
#include <vector>

#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/gardasoft/gardasoft_strobe.h"
#include "drivers/gpio/gpio_lines.h"
#include "drivers/modbus/modbus_rejector.h"

namespace hord::firmware {
namespace {

// Waits for the rejector's link: the driver writes the safe state before it reports the link.
struct SafeState final : hal::Rejector::Listener {
    explicit SafeState(SdEventLoop& l) : loop(l) {}
    void on_reject(const hal::RejectReport&) override {}
    void on_rejector_link(bool up, const Error& why_down) override {
        reached = up;
        why = why_down;
        if (up) loop.request_stop();
    }
    SdEventLoop& loop;
    bool reached = false;
    Error why;
};

}  // namespace

Result<void> make_safe(const Config& config, Duration patience) {
    Result<void> lights;
    std::vector<drivers::GpioLine> lines;
    if (config.strobe.controller) {
        lines = config.strobe.controller->triggers;
        lights = drivers::set_dark(config.strobe.controller->gardasoft);
    }
    if (!config.strobe.gpio.empty()) {
        for (const drivers::GpioStrobeChannel& channel : config.strobe.gpio) lines.push_back(channel.line);
    }
    if (!lines.empty()) {
        if (const auto taken = drivers::request_outputs(lines); !taken)  // off; released at once
            lights = tl::unexpected(taken.error());
    }
    const auto* configured = std::get_if<drivers::ModbusRejectorOptions>(&config.rejector);
    if (configured == nullptr) return lights;
    auto loop = SdEventLoop::open();
    if (!loop) return tl::unexpected(loop.error());
    SafeState safe(**loop);
    drivers::ModbusRejector rejector(**loop, *configured);
    if (auto started = rejector.start(safe); !started) return started;
    (*loop)->call_after(patience, [&] { (*loop)->request_stop(); });
    const auto ran = (*loop)->run();
    rejector.stop();
    if (!ran) return ran;
    if (!safe.reached) {
        return fail(ErrorCode::timeout, "the rejector was not brought to its safe state: " + safe.why.what,
                    "stop the line by hand; wire its run permit so that a module without link drops it");
    }
    return lights;
}

}  // namespace hord::firmware
