// The simulated world below the real drivers: it moves the light barrier's GPIO line, watches the collimators', writes
// into the video device the frame for this light, and acts as the rejector's Modbus module. The station above it is
// the installed one, unchanged.
//
//   hord_rig_world line ...      parts on the belt, with faults; prints and checks the fate of each
//   hord_rig_world camera ...    a video device that sends frames continuously, for the contract suites
//   hord_rig_world edges ...     only the light barrier's wire and the module, for hordctl latency
//   hord_rig_world plc ...       acknowledges every result and prints it
//
// Output, one event a line: seconds on the machine's monotonic clock, event, details.
#include <cstdio>
#include <functional>
#include <random>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "common/frame.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/registers/register_client.h"
#include "tests/support/modbus_module/modbus_module.h"
#include "tests/system/rig/lamps.h"
#include "tests/system/rig/line.h"
#include "tests/system/rig/video_out.h"

namespace {

using namespace hord;
using namespace std::chrono_literals;
using hal::TimePoint;

void say(TimePoint at, const std::string& what) {
    fmt::print("{:.6f} {}\n", std::chrono::duration<double>(at.time_since_epoch()).count(), what);
    std::fflush(stdout);
}

// ---- the camera

int run_camera(const std::string& device, int width_px, int height_px, int period_ms) {
    auto loop = firmware::SdEventLoop::open();
    if (!loop) throw std::runtime_error(loop.error().message());
    rig::VideoOut video(device, width_px, height_px);
    std::vector<std::byte> samples(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
    std::uint8_t shade = 0;
    std::function<void()> send = [&] {
        std::ranges::fill(samples, std::byte(++shade));
        video.send({samples.data(), width_px, height_px, width_px, 8});
        (*loop)->call_after(std::chrono::milliseconds(period_ms), send);
    };
    (*loop)->post(send);
    if (auto signal = (*loop)->stop_on_signals(); !signal) throw std::runtime_error(signal.error().message());
    return (*loop)->run() ? 0 : 1;
}

// ---- edges

// Parts pass the barrier endlessly, at random distances of 25 to 40 ms; the module answers independently of the
// station's process.
int run_edges(const std::string& chip, int port) {
    auto loop = firmware::SdEventLoop::open();
    if (!loop) throw std::runtime_error(loop.error().message());
    auto module = test::ModbusModule::open(**loop, {.port = port, .realtime = 60});
    if (!module) throw std::runtime_error(module.error().message());
    rig::DrivenLine barrier(chip, "BARRIER");
    barrier.drive(false);
    std::mt19937 chance(1);
    bool high = false;
    std::function<void()> next = [&] {
        barrier.drive(high = !high);
        (*loop)->call_after(
            high ? std::chrono::microseconds(5000) : std::chrono::microseconds(20'000 + chance() % 15'000), next);
    };
    (*loop)->post(next);
    say((*loop)->now(), "ready");
    if (auto signal = (*loop)->stop_on_signals(); !signal) throw std::runtime_error(signal.error().message());
    return (*loop)->run() ? 0 : 1;
}

// ---- the PLC

// Reads the newest sequence and acknowledges it, endlessly. The station must have stored every result printed here.
int run_plc(const std::string& where) {
    using namespace firmware;
    auto loop = SdEventLoop::open();
    const auto endpoint = modbus::parse_endpoint(where);
    if (!loop || !endpoint) throw std::runtime_error("no loop, or no such address: " + where);
    auto client = modbus::Client::connect(*endpoint, 2000ms);
    if (!client) throw std::runtime_error(client.error().message());
    std::uint32_t told = 0;
    const auto ask = [&] {
        const auto boot = client->read(7, 2), last = client->read(106, 2);
        if (!boot || !last) return;
        const std::uint32_t sequence = (static_cast<std::uint32_t>((*last)[0]) << 16) | (*last)[1];
        if (sequence == told || !client->write(8103, *last)) return;
        told = sequence;
        say((*loop)->now(),
            fmt::format("acknowledged {} {}", (static_cast<std::uint32_t>((*boot)[0]) << 16) | (*boot)[1], sequence));
    };
    std::function<void()> again = [&] {
        ask();
        (*loop)->call_after(50ms, again);
    };
    (*loop)->post(again);
    if (auto signal = (*loop)->stop_on_signals(); !signal) throw std::runtime_error(signal.error().message());
    return (*loop)->run() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App program{"hord_rig_world: what stands below the real drivers inside the rig's machine"};
    program.require_subcommand(1);
    rig::LineOptions line;
    auto* belt = program.add_subcommand("line", "Parts on the belt");
    belt->add_option("--chip", line.chip, "The gpio-sim chip's folder in configfs")->required();
    belt->add_option("--video", line.video, "The v4l2loopback device")->required();
    belt->add_option("--frames", line.frames, "Folder of empty.pgm, good*.pgm and bad parts")->required();
    belt->add_option("--port", line.port, "Of the Modbus module, on 127.0.0.1")->capture_default_str();
    belt->add_option("--parts", line.parts, "How many come")->capture_default_str();
    belt->add_option("--seed", line.seed)->capture_default_str();
    belt->add_option("--faults", line.faults, "At which parts: 3=bounce,7=no-frame");
    belt->add_option("--serial", line.serial,
                     "The module answers on a serial line instead: the far end of the station's");
    belt->add_option("--person", line.person,
                     "The station's registers: somebody clears the belt after a stop, and resets the station");
    belt->add_option("--kills", line.kills,
                     "Kill the service so often, at random moments, and measure what comes of it");
    belt->add_option("--safe-ms", line.safe_ms,
                     "Longest time from a kill to lights off and outputs at rest; 0: only told")
        ->capture_default_str();
    belt->add_option("--good-share", line.good_share, "Of the parts")->capture_default_str();
    belt->add_option("--patience", line.patience_s, "Give up after so many seconds")->capture_default_str();
    std::string device = "/dev/video10", plc = "127.0.0.1:502";
    int width = 320, height = 240, period = 30;
    auto* camera = program.add_subcommand("camera", "Frames without end");
    camera->add_option("--video", device)->capture_default_str();
    camera->add_option("--width", width)->capture_default_str();
    camera->add_option("--height", height)->capture_default_str();
    camera->add_option("--period", period, "ms")->capture_default_str();
    auto* edges = program.add_subcommand("edges", "The barrier's edges and the module, without a belt");
    edges->add_option("--chip", line.chip, "The gpio-sim chip's folder in configfs")->required();
    edges->add_option("--port", line.port, "Of the Modbus module, on 127.0.0.1")->capture_default_str();
    auto* acknowledge = program.add_subcommand("plc", "Acknowledges every result");
    acknowledge->add_option("--modbus", plc)->capture_default_str();
    CLI11_PARSE(program, argc, argv);
    try {
        if (*belt) return rig::run_line(line);
        if (*edges) return run_edges(line.chip, line.port);
        if (*camera) return run_camera(device, width, height, period);
        return run_plc(plc);
    } catch (const std::exception& error) {
        fmt::print(stderr, "hord_rig_world: {}\n", error.what());
        return 2;
    }
}
