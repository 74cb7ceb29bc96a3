// The simulated world below the real drivers: it moves the light barrier's GPIO line, watches the collimators', writes into the video
// device the frame that this light shows, and is the rejector's Modbus module. The station above it is the installed one
// and knows nothing of it.
//
//   hord_rig_world line ...      parts on the belt, with faults; says what became of each, and whether that is right
//   hord_rig_world camera ...    a video device that never rests, for the contract suites
//   hord_rig_world plc ...       acknowledges every result, and says which
//
// What it says, a line each: seconds on the machine's monotonic clock, what, and details.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "algo/frame.h"
#include "firmware/event_loop_sd.h"
#include "firmware/modbus/client.h"
#include "hal_sim/cell/world.h"
#include "hal_sim/coil_module/coil_module.h"
#include "tests/rig/lamps.h"
#include "tests/rig/video_out.h"

namespace {

using namespace hord;
using namespace std::chrono_literals;
using hal::TimePoint;

void say(TimePoint at, const std::string& what) {
    fmt::print("{:.6f} {}\n", std::chrono::duration<double>(at.time_since_epoch()).count(), what);
    std::fflush(stdout);
}

// 8-bit binary PGM without comments, as hord_rig_frames writes it: a decoder of pictures would take longer to load than all the rest.
algo::Frame read_pgm(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    std::string magic;
    int width = 0, height = 0, full = 0;
    in >> magic >> width >> height >> full;
    in.get();
    if (!in || magic != "P5" || full != 255 || width < 1 || height < 1) throw std::runtime_error(file.string() + " is no 8-bit PGM");
    algo::Frame frame(width, height, 8);
    in.read(reinterpret_cast<char*>(frame.bytes().data()), static_cast<std::streamsize>(frame.bytes().size()));
    if (!in) throw std::runtime_error(file.string() + " is cut off");
    return frame;
}

// ---- the line

// What happens at one part. The outcome is stated: everything but `none` and `bounce` has the part rejected.
const std::set<std::string> kFaults = {"bounce", "no-frame", "short-frame", "late-frame", "twice", "camera-gone"};

struct LineOptions {
    std::string chip, video, frames, faults;
    int port = 1503;
    std::uint64_t parts = 20, seed = 1;
    double good_share = 0.6, speed_mm_s = 50, pitch_mm = 100, part_mm = 40, camera_mm = 35, ejector_mm = 300;
    int light_ms = 200, readout_ms = 250, patience_s = 300;
};

class Line {
  public:
    Line(firmware::SdEventLoop& loop, const LineOptions& options)
        : loop_(loop), options_(options), barrier_(options.chip, "BARRIER"), frames_(load(options.frames)),
          video_(options.video, frames_.begin()->second.width_px(), frames_.begin()->second.height_px()),
          world_(loop, no_faults_, conveyor(options), schedule(options), geometry(options), options.seed) {
        barrier_.drive(false);
        read_faults();
        auto module = sim::CoilModule::open(loop, {.port = options.port});
        if (!module) throw std::runtime_error(module.error().message());
        module_ = std::move(*module);
        module_->on_coil([this](int coil, bool on, TimePoint at) {
            loop_.post([this, coil, on, at] { on_coil(coil, on, at); });
        });
        world_.watch({.part_edge = [this](const sim::PartRecord& part, bool arrives, TimePoint) { on_edge(part, arrives); },
                      .part_gone = [this](const sim::PartRecord& part) { on_gone(part); },
                      .ejector = {},
                      .over = [this] { loop_.call_after(2s, [this] { loop_.request_stop(); }); }});
        lamps_.emplace(loop, options.chip, std::vector<std::string>{"COLLIMATOR_A", "COLLIMATOR_B"}, [this](std::uint32_t lit, TimePoint at) {
            loop_.post([this, lit, at] { on_lamps(lit, at); });
        });
        loop_.call_after(std::chrono::seconds(options.patience_s), [this] { loop_.request_stop(); });
        say(loop_.now(), "ready");
    }

    // True: every part came, left, and had the fate that it should have.
    bool finish() {
        lamps_.reset();
        const sim::WorldTotals& totals = world_.totals();
        say(loop_.now(), fmt::format("totals arrived {} ejected-good {} ejected-bad {} left-good {} left-bad {} pulses {} flashes {} longest-flash-ms {:.1f} wrong {}", totals.arrived,
                                     totals.ejected_good, totals.ejected_bad, totals.left_good, totals.left_bad, totals.ejector_pulses, flashes_,
                                     std::chrono::duration<double, std::milli>(longest_flash_).count(), wrong_));
        return world_.finished() && wrong_ == 0 && totals.arrived == options_.parts;
    }

  private:
    static sim::ConveyorOptions conveyor(const LineOptions& o) {
        sim::ConveyorOptions conveyor;
        conveyor.speed_mm_s = o.speed_mm_s;
        return conveyor;
    }
    // One kind a picture, "good*" or bad; "empty" is the field without a part.
    sim::ScheduleOptions schedule(const LineOptions& o) {
        sim::ScheduleOptions schedule;
        schedule.parts = o.parts;
        schedule.pitch_mm = o.pitch_mm;
        schedule.part_length_mm = o.part_mm;
        schedule.kinds.clear();
        int good = 0, bad = 0;
        for (const auto& [name, frame] : frames_) {
            if (name == "empty") continue;
            schedule.kinds.push_back({name, !name.starts_with("good"), 1});
            ++(schedule.kinds.back().bad ? bad : good);
        }
        for (sim::PartKind& kind : schedule.kinds) kind.share = kind.bad ? (1 - o.good_share) / bad : o.good_share / good;
        return schedule;
    }
    static sim::GeometryOptions geometry(const LineOptions& o) {
        sim::GeometryOptions geometry;
        geometry.camera_mm = o.camera_mm;
        geometry.ejector_mm = o.ejector_mm;
        geometry.exit_mm = o.ejector_mm + 100;
        return geometry;
    }
    static std::map<std::string, algo::Frame> load(const std::string& folder) {
        std::map<std::string, algo::Frame> frames;
        for (const auto& entry : std::filesystem::directory_iterator(folder)) {
            if (entry.path().extension() == ".pgm") frames.emplace(entry.path().stem().string(), read_pgm(entry.path()));
        }
        if (!frames.contains("empty") || frames.size() < 3) throw std::runtime_error(folder + " needs empty.pgm, a good and a bad part");
        return frames;
    }
    void read_faults() {  // "3=bounce,7=no-frame"
        std::istringstream list(options_.faults);
        for (std::string item; std::getline(list, item, ',');) {
            const auto equals = item.find('=');
            const std::string name = equals == std::string::npos ? "" : item.substr(equals + 1);
            if (!kFaults.contains(name)) throw std::runtime_error("no such fault: " + item);
            faults_[std::stoull(item)] = name;
        }
    }
    [[nodiscard]] std::string fault_of(std::uint64_t part) const {
        const auto found = faults_.find(part);
        return found == faults_.end() ? "none" : found->second;
    }
    [[nodiscard]] const std::string& kind_of(const sim::PartRecord& part) const { return world_.schedule().kinds[part.kind].name; }

    // The permit moves the belt, as it would a real line's.
    void on_coil(int coil, bool on, TimePoint at) {
        say(at, fmt::format("coil {} {}", coil, on ? 1 : 0));
        if (coil == 0) world_.set_ejector(on, at);
        if (coil != 1) return;
        if (on && !std::exchange(started_, true)) world_.start();
        else if (on) world_.resume();
        else if (started_) world_.halt();
    }

    void on_edge(const sim::PartRecord& part, bool arrives) {
        if (arrives) say(loop_.now(), fmt::format("part {} {} {}", part.number, kind_of(part), fault_of(part.number)));
        barrier_.drive(arrives);
        if (fault_of(part.number) != "bounce") return;
        for (int k = 1; k <= 4; ++k) {
            loop_.call_after(k * 6ms, [this, arrives, k] { barrier_.drive(arrives == (k % 2 == 0)); });
        }
    }

    void on_lamps(std::uint32_t lit, TimePoint at) {
        say(at, fmt::format("lamps {}", lit));
        if (lit != 0 && !lit_since_) lit_since_ = at;
        if (lit != 0 || !lit_since_) return;
        const TimePoint since = *std::exchange(lit_since_, std::nullopt);
        ++flashes_;
        longest_flash_ = std::max(longest_flash_, at - since);
        const auto view = world_.in_view(since + (at - since) / 2);
        const bool light_is_right = at - since > options_.light_ms * 1ms / 2 && at - since < options_.light_ms * 2ms;
        loop_.call_at(at + options_.readout_ms * 1ms, [this, light_is_right, number = view.part == nullptr ? 0 : view.part->number,
                                                       kind = view.part == nullptr ? std::string("empty") : kind_of(*view.part)] { read_out(number, kind, light_is_right); });
    }

    // What the sensor sends. A light of the wrong length gives a dark frame.
    void read_out(std::uint64_t part, const std::string& kind, bool light_is_right) {
        const std::string fault = fault_of(part);
        const auto send = [this, part, kind, light_is_right](std::size_t bytes) {
            const algo::FrameView whole = frames_.at(kind).view();
            static const std::vector<std::byte> nothing(static_cast<std::size_t>(whole.stride_bytes * whole.height_px));
            const algo::FrameView black{nothing.data(), whole.width_px, whole.height_px, whole.stride_bytes, whole.bits};
            say(loop_.now(), fmt::format("frame {} {}", part, light_is_right ? kind : "dark"));
            video_.send(light_is_right ? whole : black, bytes);
        };
        if (fault == "no-frame") return;
        if (fault == "camera-gone") {
            video_.close();
            loop_.call_after(500ms, [this] { video_.open(); });
            return;
        }
        if (fault == "late-frame") {
            loop_.call_after(900ms, [send] { send(SIZE_MAX); });
            return;
        }
        const algo::FrameView whole = frames_.at(kind).view();
        send(fault == "short-frame" ? static_cast<std::size_t>(whole.width_px) * static_cast<std::size_t>(whole.height_px) / 2 : SIZE_MAX);
        if (fault == "twice") loop_.call_after(30ms, [send] { send(SIZE_MAX); });
    }

    void on_gone(const sim::PartRecord& part) {
        const std::string fault = fault_of(part.number);
        const bool ejected = part.fate == sim::PartRecord::Fate::ejected;
        const bool harmless = fault == "none" || fault == "bounce" || fault == "twice";
        const bool should = part.bad || !harmless;
        if (ejected != should) ++wrong_;
        say(loop_.now(), fmt::format("gone {} {} {} {} {}", part.number, kind_of(part), fault, ejected ? "ejected" : "left", ejected == should ? "right" : "WRONG"));
    }

    firmware::SdEventLoop& loop_;
    LineOptions options_;
    rig::DrivenLine barrier_;
    std::map<std::string, algo::Frame> frames_;
    rig::VideoOut video_;
    sim::FaultPlan no_faults_{1, {}};
    sim::World world_;
    std::map<std::uint64_t, std::string> faults_;
    std::unique_ptr<sim::CoilModule> module_;
    std::optional<rig::LampWatch> lamps_;
    std::optional<TimePoint> lit_since_;
    hal::Duration longest_flash_{};
    std::uint64_t flashes_ = 0, wrong_ = 0;
    bool started_ = false;
};

int run_line(const LineOptions& options) {
    auto loop = firmware::SdEventLoop::open();
    if (!loop) throw std::runtime_error(loop.error().message());
    if (auto signal = (*loop)->stop_on_signals(); !signal) throw std::runtime_error(signal.error().message());
    Line line(**loop, options);
    if (auto ran = (*loop)->run(); !ran) throw std::runtime_error(ran.error().message());
    return line.finish() ? 0 : 1;
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

// ---- the PLC

// Reads the newest sequence and acknowledges it, for ever. What is said here, the station has promised to keep.
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
        say((*loop)->now(), fmt::format("acknowledged {} {}", (static_cast<std::uint32_t>((*boot)[0]) << 16) | (*boot)[1], sequence));
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
    LineOptions line;
    auto* belt = program.add_subcommand("line", "Parts on the belt");
    belt->add_option("--chip", line.chip, "The gpio-sim chip's folder in configfs")->required();
    belt->add_option("--video", line.video, "The v4l2loopback device")->required();
    belt->add_option("--frames", line.frames, "Folder of empty.pgm, good*.pgm and bad parts")->required();
    belt->add_option("--port", line.port, "Of the Modbus module, on 127.0.0.1")->capture_default_str();
    belt->add_option("--parts", line.parts, "How many come")->capture_default_str();
    belt->add_option("--seed", line.seed)->capture_default_str();
    belt->add_option("--faults", line.faults, "At which parts: 3=bounce,7=no-frame");
    belt->add_option("--patience", line.patience_s, "Give up after so many seconds")->capture_default_str();
    std::string device = "/dev/video10", plc = "127.0.0.1:502";
    int width = 320, height = 240, period = 30;
    auto* camera = program.add_subcommand("camera", "Frames without end");
    camera->add_option("--video", device)->capture_default_str();
    camera->add_option("--width", width)->capture_default_str();
    camera->add_option("--height", height)->capture_default_str();
    camera->add_option("--period", period, "ms")->capture_default_str();
    auto* acknowledge = program.add_subcommand("plc", "Acknowledges every result");
    acknowledge->add_option("--modbus", plc)->capture_default_str();
    CLI11_PARSE(program, argc, argv);
    try {
        if (*belt) return run_line(line);
        if (*camera) return run_camera(device, width, height, period);
        return run_plc(plc);
    } catch (const std::exception& error) {
        fmt::print(stderr, "hord_rig_world: {}\n", error.what());
        return 2;
    }
}
