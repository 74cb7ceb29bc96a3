// What a GenICam camera's frames cost, and how many arrive: Aravis's fake GigE camera over loopback, running free, the
// real sensor driver and its process. Every process on one core; --core -1: on all.
//     bench_genicam [--seconds 10] [--size 5120x4992] [--core 0] [--mtu BYTES]
// With --mtu the camera is in a network of its own, behind a pair of virtual Ethernet interfaces of this MTU (root,
// ip), and the packet size is negotiated. A row for each packet size and frame rate: frames that arrived a second, MB a
// second, frames that are missing (gaps of the sequence) or damaged, and the processor time a frame of camera,
// hord-genicam and station. The kernel's share of sending over loopback, reception included, counts as the camera's.
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/genicam/genicam_sensor.h"
#include "tests/drivers/genicam/fake_gige.h"

namespace {

using namespace hord;
using namespace std::chrono_literals;

struct Ear final : hal::Sensor::Listener {
    void on_frame(hal::FrameLease frame) override {
        const auto& info = frame.info();
        if (info.corrupt) ++damaged;
        else ++whole;
        if (last != 0 && info.sequence > last + 1) missing += info.sequence - last - 1;
        last = info.sequence;
        waiting = false;
    }
    void on_sensor_lost(const Error& error) override { lost = error.message(); }
    std::uint32_t last = 0, missing = 0;
    int whole = 0, damaged = 0;
    bool waiting = false;
    std::string lost;
};

// Processor time of the processes of this name that this process started, and of itself; s.
double processor_time(const std::string& name) {
    const auto of = [](const std::filesystem::path& folder) {
        std::ifstream in(folder / "stat");
        std::string text((std::istreambuf_iterator<char>(in)), {});
        text.erase(0, text.rfind(')') + 2);
        std::istringstream fields(text);
        std::string skip;
        for (int k = 0; k < 11; ++k) fields >> skip;
        double user = 0, system = 0;
        fields >> user >> system;
        return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
    };
    if (name.empty()) return of("/proc/self");
    double all = 0;
    for (const auto& process : std::filesystem::directory_iterator("/proc")) {
        std::ifstream command(process.path() / "comm");
        std::string comm, parent_line;
        if (!std::getline(command, comm) || comm != name.substr(0, 15)) continue;
        std::ifstream status(process.path() / "status");
        while (std::getline(status, parent_line)) {
            if (parent_line == "PPid:\t" + std::to_string(getpid())) all += of(process.path());
        }
    }
    return all;
}

struct Options {
    double seconds = 10;
    int width_px = 5120, height_px = 4992, core = 0, mtu = 0;
    [[nodiscard]] std::string address() const { return mtu > 0 ? "10.77.0.2" : "127.0.0.1"; }
};

bool shell(const std::string& command) { return std::system(command.c_str()) == 0; }

// Calls `act` in a network of its own, which a pair of interfaces joins with this process's one. It ends with this
// process.
bool in_network_behind(int mtu, const std::function<void()>& act) {
    const common::UniqueFd own(::open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC));
    if (::unshare(CLONE_NEWNET) != 0) return false;
    const common::UniqueFd other(::open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC));
    const pid_t holder = ::fork();  // of the new network, by whose id it is named
    if (holder == 0) {
        ::prctl(PR_SET_PDEATHSIG, SIGKILL);
        for (;;) ::pause();
    }
    const std::string size = std::to_string(mtu);
    bool good = ::setns(own.get(), CLONE_NEWNET) == 0 &&
        shell("ip link add hord0 mtu " + size + " type veth peer name hord1 mtu " + size + " netns " +
              std::to_string(holder) + " && ip addr add 10.77.0.1/24 dev hord0 && ip link set hord0 up") &&
        ::setns(other.get(), CLONE_NEWNET) == 0 &&
        shell("ip link set lo up && ip addr add 10.77.0.2/24 dev hord1 && ip link set hord1 up");
    if (good) act();
    ::sleep(2);  // until both interfaces have a carrier: what is sent before is lost
    good = ::setns(own.get(), CLONE_NEWNET) == 0 && good;
    return good;
}

bool measure(firmware::SdEventLoop& loop, const Options& options, int packet_bytes, double rate) {
    drivers::GenicamSensorOptions camera{.width_px = options.width_px,
                                         .height_px = options.height_px,
                                         .trigger = drivers::CameraTrigger::free,
                                         .packet_bytes = packet_bytes};
    camera.features = {{"AcquisitionFrameRate", fmt::format("{:.3f}", rate)}};
    auto sensor = drivers::open_genicam_sensor(loop, camera);
    Ear ear;
    Result<void> started;
    if (sensor) started = (*sensor)->start(ear);
    if (!sensor || !started) {
        fmt::print(stderr, "{}\n", (!sensor ? sensor.error() : started.error()).message());
        return false;
    }
    // A frame is asked for as soon as the last one has come; the camera runs free.
    std::uint32_t exposure = 0;
    const auto ask = [&] {
        if (ear.waiting) return;
        ear.waiting = (*sensor)->trigger({++exposure, loop.now(), 1ms}).has_value();
    };
    const auto run = [&](hal::Duration time) {
        const auto until = loop.now() + time;
        while (loop.now() < until && ear.lost.empty()) {
            ask();
            loop.run_until([&] { return !ear.waiting; }, 50ms);
        }
    };
    run(2s);
    const std::array<std::string, 3> names{"hord_fake_gige", "hord-genicam", ""};
    std::array<double, 3> before{};
    for (std::size_t k = 0; k < names.size(); ++k) before[k] = processor_time(names[k]);
    ear = {};
    const auto began = loop.now();
    run(std::chrono::duration_cast<hal::Duration>(std::chrono::duration<double>(options.seconds)));
    const double took = std::chrono::duration<double>(loop.now() - began).count();
    std::array<double, 3> used{};
    for (std::size_t k = 0; k < names.size(); ++k) used[k] = processor_time(names[k]) - before[k];
    (*sensor)->stop();
    const int all = std::max(1, ear.whole + ear.damaged);
    fmt::print("| {} | {:g} | {:.1f} | {:.0f} | {} of {} | {} | {:.1f} | {:.1f} | {:.2f} |{}\n",
               packet_bytes == 0 ? "negotiated" : std::to_string(packet_bytes), rate, ear.whole / took,
               ear.whole / took * options.width_px * options.height_px / 1e6, ear.missing,
               static_cast<std::uint32_t>(all) + ear.missing, ear.damaged, used[0] / all * 1e3, used[1] / all * 1e3,
               used[2] / all * 1e3, ear.lost.empty() ? "" : " lost: " + ear.lost);
    std::fflush(stdout);
    return true;
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    for (int k = 1; k + 1 < argc; k += 2) {
        const std::string key = argv[k];
        if (key == "--seconds") options.seconds = std::stod(argv[k + 1]);
        else if (key == "--mtu") options.mtu = std::stoi(argv[k + 1]);
        else if (key == "--core") options.core = std::stoi(argv[k + 1]);
        else if (key != "--size" || std::sscanf(argv[k + 1], "%dx%d", &options.width_px, &options.height_px) != 2)
            return fmt::print(stderr, "unknown option {}\n", key), 2;
    }
    if (const std::string refused = test::own_network(); !refused.empty())
        return fmt::print(stderr, "{}\n", refused), 2;
    cpu_set_t cores;
    CPU_ZERO(&cores);
    CPU_SET(static_cast<unsigned>(std::max(options.core, 0)), &cores);
    if (options.core >= 0 && sched_setaffinity(0, sizeof cores, &cores) != 0)
        return fmt::print(stderr, "no core {}\n", options.core), 2;
    std::optional<test::FakeGige> camera;
    const auto switch_on = [&] {
        camera.emplace(std::vector<std::string>{options.address(), "S1", "still", "test-packets",
                                                fmt::format("size={}x{}", options.width_px, options.height_px)});
    };
    if (options.mtu == 0) switch_on();
    else if (!in_network_behind(options.mtu, switch_on)) return fmt::print(stderr, "no pair of interfaces\n"), 2;
    auto loop = firmware::SdEventLoop::open();
    if (!loop) return fmt::print(stderr, "{}\n", loop.error().message()), 2;
    fmt::print("{} x {} Mono8, {} s a row, processes on {}\n\n", options.width_px, options.height_px, options.seconds,
               options.core < 0 ? "all cores" : fmt::format("core {}", options.core));
    fmt::print(
        "| packet, bytes | camera set to, frames/s | arrived, frames/s | MB/s | missing | damaged | camera, ms a frame "
        "| "
        "hord-genicam, ms a frame | station, ms a frame |\n|---|---|---|---|---|---|---|---|---|\n");
    for (const int packet : options.mtu > 0 ? std::vector{0} : std::vector{1500, 9000}) {
        for (const double rate : {1.0, 5.0, 20.0, 100.0}) {
            if (!measure(**loop, options, packet, rate)) return 1;
        }
    }
    return 0;
}
