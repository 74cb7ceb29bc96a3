#include "tests/system/rig/line.h"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include "common/frame.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/core/station_types.h"
#include "hal_sim/world/world.h"
#include "tests/support/modbus_module/modbus_module.h"
#include "tests/system/rig/cable.h"
#include "tests/system/rig/killer.h"
#include "tests/system/rig/lamps.h"
#include "tests/system/rig/person.h"
#include "tests/system/rig/video_out.h"

namespace hord::rig {
namespace {

using namespace std::chrono_literals;
using hal::TimePoint;

double ms(hal::Duration duration) { return std::chrono::duration<double, std::milli>(duration).count(); }

void say(TimePoint at, const std::string& what) {
    fmt::print("{:.6f} {}\n", std::chrono::duration<double>(at.time_since_epoch()).count(), what);
    std::fflush(stdout);
}

// 8-bit binary PGM without comments, as hord_rig_frames writes it. An image library would take longer to load than the
// rest of the program.
Frame read_pgm(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    std::string magic;
    int width = 0, height = 0, full = 0;
    in >> magic >> width >> height >> full;
    in.get();
    if (!in || magic != "P5" || full != 255 || width < 1 || height < 1)
        throw std::runtime_error(file.string() + " is no 8-bit PGM");
    Frame frame(width, height, 8);
    in.read(reinterpret_cast<char*>(frame.bytes().data()), static_cast<std::streamsize>(frame.bytes().size()));
    if (!in) throw std::runtime_error(file.string() + " is cut off");
    return frame;
}

// Faults at one part. With these the part is still judged correctly ...
const std::set<std::string> kHarmless = {"none", "bounce", "twice", "noise", "edges-lost"};
// ... and with these it is rejected.
const std::set<std::string> kUnjudged = {"no-frame", "short-frame", "late-frame", "camera-gone", "too-close"};

// The station continues to reject parts that it knows to be on the line: the next part's command comes two seconds
// after this one's.
constexpr auto kNextCommand = 1800ms;

// The module's fault at the next write, which is the command for the part. The permit must fall; the ejector moves at
// most once.
struct ModuleFault {
    test::ModuleFault how;
    hal::Duration delay{};
    bool moves = false;  // whether the ejector moves
};
const std::map<std::string, ModuleFault> kModuleFaults = {
    {"reject-refused", {test::ModuleFault::exception}},
    {"reject-late", {test::ModuleFault::late, 150ms, true}},  // the station's time-out is 100 ms
    {"reject-drip", {test::ModuleFault::drip, 13ms, true}},   // 12 bytes
    {"reject-close", {test::ModuleFault::close}},
    {"reject-stuck", {test::ModuleFault::stuck}},
    {"module-reboot", {test::ModuleFault::none, 2000ms, true}},  // absent for this time, from the middle of the pulse
};

class Line {
  public:
    Line(firmware::SdEventLoop& loop, const LineOptions& options)
        : loop_(loop), options_(options), barrier_(options.chip, "BARRIER"), frames_(load(options.frames)),
          video_(options.video, frames_.begin()->second.width_px(), frames_.begin()->second.height_px()),
          world_(loop, no_faults_, conveyor(options), schedule(options), geometry(options), options.seed) {
        barrier_.drive(false);
        read_faults();
        auto module = test::ModbusModule::open(loop, {.port = options.port, .serial = !options.serial.empty()});
        if (!module) throw std::runtime_error(module.error().message());
        module_ = std::move(*module);
        if (!options.serial.empty()) cable_ = std::make_unique<Cable>(module_->device(), options.serial, options.seed);
        if (!options.person.empty()) person_ = std::make_unique<Person>(options.person);
        if (options.kills > 0) {
            if (!person_) throw std::runtime_error("--kills needs --person");
            killer_ = std::make_unique<Killer>(
                loop, options.kills, options.safe_ms * 1ms, options.seed,
                Killer::Watchers{[this] { return person_->executes(); }, say, [this] { loop_.request_stop(); }});
        }
        module_->on_coil(
            [this](int coil, bool on, TimePoint at) { loop_.post([this, coil, on, at] { on_coil(coil, on, at); }); });
        world_.watch(
            {.part_edge = [this](const sim::PartRecord& part, bool arrives, TimePoint) { on_edge(part, arrives); },
             .part_gone = [this](const sim::PartRecord& part) { on_gone(part); },
             .ejector = {},
             .over = [this] { loop_.call_after(2s, [this] { loop_.request_stop(); }); }});
        lamps_.emplace(loop, options.chip, std::vector<std::string>{"COLLIMATOR_A", "COLLIMATOR_B"},
                       [this](std::uint32_t lit, TimePoint at) { loop_.post([this, lit, at] { on_lamps(lit, at); }); });
        loop_.call_after(std::chrono::seconds(options.patience_s), [this] { loop_.request_stop(); });
        say(loop_.now(), "ready");
    }

    // True if every part came, left and had the expected fate.
    bool finish() {
        lamps_.reset();
        if (injection_) settle_injection();
        const sim::WorldTotals& totals = world_.totals();
        say(loop_.now(),
            fmt::format("totals arrived {} ejected-good {} ejected-bad {} left-good {} left-bad {} removed {} pulses "
                        "{} flashes {} longest-flash-ms {:.1f} wrong {}",
                        totals.arrived, totals.ejected_good, totals.ejected_bad, totals.left_good, totals.left_bad,
                        totals.removed, totals.ejector_pulses, flashes_,
                        std::chrono::duration<double, std::milli>(longest_flash_).count(), wrong_));
        const std::uint32_t faults = person_ ? person_->take_faults() : 0;
        if (person_)
            say(loop_.now(),
                fmt::format("resets {} stops {} rejections-failed {} faults {:#x}", person_->resets(), stops_,
                            person_->reject_failed(), faults));
        const bool asks_for_edges =
            std::ranges::any_of(faults_, [](const auto& fault) { return fault.second == "edges-lost"; });
        // It is unknown what passed: the line must stop before the next part could be mistaken for it, and the
        // station must report the fault.
        const bool told = stopped_for_edges_ && (faults & firmware::kFaultPartSensor) != 0;
        if (asks_for_edges) {
            say(loop_.now(),
                fmt::format("edges-lost: {}, fault part-sensor {} {}",
                            stopped_for_edges_
                                ? fmt::format("permit down {:.0f} ms after the station ran on", ms(*stopped_for_edges_))
                                : std::string("permit never down"),
                            (faults & firmware::kFaultPartSensor) != 0 ? "up" : "never up", told ? "right" : "WRONG"));
            if (!told) ++wrong_;
        }
        if (cable_) say(loop_.now(), fmt::format("disturbed {}", cable_->disturbed()));
        const bool fired = module_faults_left_ == 0 && (!cable_ || hums_ == 0 || cable_->disturbed() > 0);
        if (!fired) say(loop_.now(), "a fault never fired");
        if (killer_) return killer_->finish() && wrong_ == 0;
        return world_.finished() && wrong_ == 0 && fired && totals.arrived == options_.parts;
    }

  private:
    static sim::ConveyorOptions conveyor(const LineOptions& o) {
        sim::ConveyorOptions conveyor;
        conveyor.speed_mm_s = o.speed_mm_s;
        return conveyor;
    }
    // Each image is one kind of part, "good*" or bad; "empty" is the field without a part.
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
        for (sim::PartKind& kind : schedule.kinds)
            kind.share = kind.bad ? (1 - o.good_share) / bad : o.good_share / good;
        return schedule;
    }
    static sim::GeometryOptions geometry(const LineOptions& o) {
        sim::GeometryOptions geometry;
        geometry.camera_mm = o.camera_mm;
        geometry.ejector_mm = o.ejector_mm;
        geometry.exit_mm = o.ejector_mm + 100;
        return geometry;
    }
    static std::map<std::string, Frame> load(const std::string& folder) {
        std::map<std::string, Frame> frames;
        for (const auto& entry : std::filesystem::directory_iterator(folder)) {
            if (entry.path().extension() == ".pgm")
                frames.emplace(entry.path().stem().string(), read_pgm(entry.path()));
        }
        if (!frames.contains("empty") || frames.size() < 3)
            throw std::runtime_error(folder + " needs empty.pgm, a good and a bad part");
        return frames;
    }
    void read_faults() {  // "3=bounce,7=no-frame"
        std::istringstream list(options_.faults);
        for (std::string item; std::getline(list, item, ',');) {
            const auto equals = item.find('=');
            const std::string name = equals == std::string::npos ? "" : item.substr(equals + 1);
            if (!kHarmless.contains(name) && !kUnjudged.contains(name) && !kModuleFaults.contains(name))
                throw std::runtime_error("no such fault: " + item);
            faults_[std::stoull(item)] = name;
            if (kModuleFaults.contains(name)) ++module_faults_left_;
        }
    }
    [[nodiscard]] std::string fault_of(std::uint64_t part) const {
        const auto found = faults_.find(part);
        return found == faults_.end() ? "none" : found->second;
    }
    [[nodiscard]] const std::string& kind_of(const sim::PartRecord& part) const {
        return world_.schedule().kinds[part.kind].name;
    }

    // The permit runs the belt, as on a real line.
    void on_coil(int coil, bool on, TimePoint at) {
        say(at, fmt::format("coil {} {}", coil, on ? 1 : 0));
        if (coil == 0) on_ejector(on, at);
        if (coil != 1) return;
        if (killer_) killer_->permit(on, at);
        if (on && !std::exchange(started_, true)) world_.start();
        else if (on) world_.resume();
        else if (started_) stand(at);
    }

    void on_ejector(bool on, TimePoint at) {
        world_.set_ejector(on, at);
        if (killer_) killer_->ejector(on, at);
        if (!injection_) return;
        injection_->ejector.push_back({on, at});
        if (!on || (injection_->fired && at > *injection_->fired + kNextCommand)) return;
        ++injection_->moves;
        if (injection_->fault != "module-reboot" || injection_->moves > 1) return;
        loop_.call_after(100ms, [this] {
            if (injection_) injection_->fired = loop_.now();
            module_->power_off();
        });
        loop_.call_after(100ms + kModuleFaults.at("module-reboot").delay, [this] {
            if (auto back = module_->power_on(); !back) say(loop_.now(), back.error().message());
        });
    }

    // No permit: the belt stands. A person removes the parts on it and may then reset the station.
    void stand(TimePoint at) {
        ++stops_;
        world_.halt();
        if (edges_lost_at_ && !stopped_for_edges_) stopped_for_edges_ = at - *edges_lost_at_;
        if (injection_ && !injection_->permit_down) injection_->permit_down = at;
        if (!person_) return;
        person_->may_reset(false);
        loop_.call_after(500ms, [this] {
            world_.take_off([](const sim::PartRecord&) { return true; });
            if (injection_)
                loop_.call_after(3s, [this] {
                    if (injection_) settle_injection();
                    person_->may_reset(true);
                });
            else person_->may_reset(true);
        });
    }

    void inject(std::uint64_t part, const std::string& fault) {
        const ModuleFault& how = kModuleFaults.at(fault);
        injection_.emplace(Injection{.fault = fault, .part = part, .misbehaved = module_->misbehaved()});
        (void)person_->take_faults();
        (void)person_->take_line_stop();
        if (how.how == test::ModuleFault::none) return;
        module_->misbehave(how.how, 1, how.delay);
        look_whether_it_fired();
    }
    void look_whether_it_fired() {
        if (!injection_ || injection_->fired) return;
        if (module_->misbehaved() > injection_->misbehaved) injection_->fired = loop_.now();
        else loop_.call_after(2ms, [this] { look_whether_it_fired(); });
    }

    // Result of the fault. The time from the command to the permit's end is what the station needs to detect the
    // failure and to reach the module again.
    void settle_injection() {
        const Injection one = *std::exchange(injection_, std::nullopt);
        --module_faults_left_;
        const ModuleFault& how = kModuleFaults.at(one.fault);
        const std::uint32_t faults = person_->take_faults();
        const bool right = one.fired && one.permit_down && one.moves == (how.moves ? 1 : 0) &&
            (one.ejector.empty() || !one.ejector.back().on) && faults != 0 && person_->take_line_stop();
        if (!right) ++wrong_;
        std::string moves;
        for (const auto& move : one.ejector) {
            moves += fmt::format("{}{} at {:.0f} ms", moves.empty() ? "" : ", ", move.on ? "out" : "back",
                                 one.fired ? ms(move.at - *one.fired) : 0.0);
        }
        say(loop_.now(),
            fmt::format("module-fault {} at part {}: {}; this command moved the ejector {} times ({}), permit down {}, "
                        "faults {:#x} {}",
                        one.fault, one.part, one.fired ? "fired" : "never fired", one.moves,
                        moves.empty() ? "it never moved" : moves,
                        one.permit_down && one.fired ? fmt::format("{:.0f} ms later", ms(*one.permit_down - *one.fired))
                                                     : std::string("never"),
                        faults, right ? "right" : "WRONG"));
    }

    void on_edge(const sim::PartRecord& part, bool arrives) {
        if (arrives) say(loop_.now(), fmt::format("part {} {} {}", part.number, kind_of(part), fault_of(part.number)));
        barrier_.drive(arrives);
        if (killer_ && arrives) killer_->edge();
        const std::string fault = fault_of(part.number);
        for (int k = 1; fault == "bounce" && k <= 4; ++k) {
            loop_.call_after(k * 6ms, [this, arrives, k] { barrier_.drive(arrives == (k % 2 == 0)); });
        }
        // An unplanned object follows it, closer than the minimum pitch, while this part's exposure still lasts.
        if (fault == "too-close" && !arrives) {
            loop_.call_after(100ms, [this] { barrier_.drive(true); });
            loop_.call_after(250ms, [this] { barrier_.drive(false); });
        }
        if (fault == "edges-lost" && !arrives) loop_.call_after(300ms, [this] { lose_edges(); });
    }

    // Between two parts an object passes the barrier ten times while the station's process is stopped: twenty edges, of
    // which the kernel keeps sixteen.
    void lose_edges() {
        static constexpr int kEdges = 20;
        const pid_t pid = service_process();
        if (pid == 0 || ::kill(pid, SIGSTOP) != 0) return say(loop_.now(), "the station's process cannot be stopped");
        for (int k = 1; k <= kEdges; ++k) {
            loop_.call_after(k * 2ms, [this, k] { barrier_.drive(k % 2 == 1); });
        }
        loop_.call_after((kEdges + 5) * 2ms, [this, pid] {
            edges_lost_at_ = loop_.now();
            ::kill(pid, SIGCONT);
            say(loop_.now(), fmt::format("edges {} while the station stood still", kEdges));
        });
    }

    void on_lamps(std::uint32_t lit, TimePoint at) {
        say(at, fmt::format("lamps {}", lit));
        if (killer_) killer_->lamps(lit, at);
        if (lit != 0 && !lit_since_) lit_since_ = at;
        if (lit != 0 || !lit_since_) return;
        const TimePoint since = *std::exchange(lit_since_, std::nullopt);
        ++flashes_;
        longest_flash_ = std::max(longest_flash_, at - since);
        const auto view = world_.in_view(since + (at - since) / 2);
        const bool light_is_right = at - since > options_.light_ms * 1ms / 2 && at - since < options_.light_ms * 2ms;
        loop_.call_at(at + options_.readout_ms * 1ms,
                      [this, light_is_right, number = view.part == nullptr ? 0 : view.part->number,
                       kind = view.part == nullptr ? std::string("empty") : kind_of(*view.part)] {
                          read_out(number, kind, light_is_right);
                      });
    }

    // The sensor's frame. A light of the wrong length yields a dark frame.
    void read_out(std::uint64_t part, const std::string& kind, bool light_is_right) {
        const std::string fault = fault_of(part);
        if (kModuleFaults.contains(fault)) inject(part, fault);
        if (fault == "noise" && cable_) {
            ++hums_;
            cable_->hum(true);
            loop_.call_after(8s, [this] { cable_->hum(false); });
        }
        const auto send = [this, part, kind, light_is_right](std::size_t bytes) {
            const FrameView whole = frames_.at(kind).view();
            static const std::vector<std::byte> nothing(static_cast<std::size_t>(whole.stride_bytes * whole.height_px));
            const FrameView black{nothing.data(), whole.width_px, whole.height_px, whole.stride_bytes, whole.bits};
            say(loop_.now(), fmt::format("frame {} {}", part, light_is_right ? kind : "dark"));
            video_.send(light_is_right ? whole : black, bytes);
            if (killer_) killer_->frame();
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
        const FrameView whole = frames_.at(kind).view();
        send(fault == "short-frame"
                 ? static_cast<std::size_t>(whole.width_px) * static_cast<std::size_t>(whole.height_px) / 2
                 : SIZE_MAX);
        if (fault == "twice") loop_.call_after(30ms, [send] { send(SIZE_MAX); });
    }

    void on_gone(const sim::PartRecord& part) {
        const std::string fault = fault_of(part.number);
        const bool ejected = part.fate == sim::PartRecord::Fate::ejected;
        if (part.fate == sim::PartRecord::Fate::removed)
            return say(loop_.now(), fmt::format("gone {} {} {} taken off", part.number, kind_of(part), fault));
        const bool should = part.bad || kUnjudged.contains(fault);
        if (ejected != should) ++wrong_;
        say(loop_.now(),
            fmt::format("gone {} {} {} {} {}", part.number, kind_of(part), fault, ejected ? "ejected" : "left",
                        ejected == should ? "right" : "WRONG"));
    }

    firmware::SdEventLoop& loop_;
    LineOptions options_;
    DrivenLine barrier_;
    std::map<std::string, Frame> frames_;
    VideoOut video_;
    sim::InjectionPlan no_faults_{1, {}};
    sim::World world_;
    std::map<std::uint64_t, std::string> faults_;
    std::unique_ptr<test::ModbusModule> module_;
    std::unique_ptr<Cable> cable_;
    std::unique_ptr<Person> person_;
    std::unique_ptr<Killer> killer_;
    struct Injection {
        std::string fault;
        std::uint64_t part = 0;
        int misbehaved = 0;  // before it
        int moves = 0;
        struct Move {
            bool on;
            TimePoint at;
        };
        std::vector<Move> ejector{};
        std::optional<TimePoint> fired{}, permit_down{};
    };
    std::optional<Injection> injection_;
    int module_faults_left_ = 0, stops_ = 0, hums_ = 0;
    std::optional<LampWatch> lamps_;
    std::optional<TimePoint> lit_since_;
    hal::Duration longest_flash_{};
    std::uint64_t flashes_ = 0, wrong_ = 0;
    std::optional<TimePoint> edges_lost_at_;
    std::optional<hal::Duration> stopped_for_edges_;
    bool started_ = false;
};

}  // namespace

int run_line(const LineOptions& options) {
    auto loop = firmware::SdEventLoop::open();
    if (!loop) throw std::runtime_error(loop.error().message());
    if (auto signal = (*loop)->stop_on_signals(); !signal) throw std::runtime_error(signal.error().message());
    Line line(**loop, options);
    if (auto ran = (*loop)->run(); !ran) throw std::runtime_error(ran.error().message());
    return line.finish() ? 0 : 1;
}

}  // namespace hord::rig
