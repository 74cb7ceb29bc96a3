// hordctl latency: how soon after an edge this machine turns a light on and has a reject command at the module, idle
// and with the pipeline busy. The drivers are the station's own; what stands behind them is said with every number.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <sched.h>
#include <semaphore.h>
#include <sys/eventfd.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "algo/inspection/pipeline.h"
#include "common/cli/progress.h"
#include "common/unique_fd.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/gpio/gpio_part_sensor.h"
#include "drivers/gpio/gpio_strobe.h"
#include "drivers/modbus/modbus_rejector.h"
#include "firmware/config/config.h"
#include "firmware/hordctl/commands.h"
#include "firmware/service/realtime.h"
#include "hal_sim/coil_module/coil_module.h"

namespace hord::firmware {
namespace {

using hal::TimePoint;

constexpr Duration kPulse = milliseconds(1);  // of the light
constexpr Duration kAhead = milliseconds(3);  // a pulse that was planned begins so long after its edge
constexpr Duration kRejectWindow = milliseconds(4);
constexpr Duration kApart = milliseconds(12), kSpread = milliseconds(10);  // from one edge's end to the next one
constexpr Duration kGivenUp = milliseconds(1000);                          // an edge without all its reports by then

struct LatencyOptions {
    std::string config;
    bool simulate = false, actuate = false, sensor = false;
    int edges = 1000, priority = 50;
};

// ---- what is measured, and how it is told

struct Series {
    std::string what;
    std::vector<Duration> samples;
    int missed = 0;
};

// What p of the samples do not exceed.
double quantile_us(const std::vector<Duration>& sorted, double p) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(sorted.size())));
    return static_cast<double>(sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1].count()) / 1e3;
}

std::string text_of(Series series) {
    std::string out = fmt::format("{}: {} measured, {} missed", series.what, series.samples.size(), series.missed);
    if (series.samples.empty()) return out + "\n";
    std::ranges::sort(series.samples);
    const auto& s = series.samples;
    out += fmt::format("; p50 {:.0f} us, p99 {:.0f} us, ", quantile_us(s, 0.5), quantile_us(s, 0.99));
    out +=
        s.size() >= 1000 ? fmt::format("p99.9 {:.0f} us, ", quantile_us(s, 0.999)) : std::string("p99.9 needs 1000, ");
    out += fmt::format("max {:.0f} us\n", quantile_us(s, 1));
    // A bar an octave of microseconds.
    std::vector<int> bars;
    for (const Duration sample : s) {
        const auto us = static_cast<std::uint64_t>(std::max<std::int64_t>(0, sample.count() / 1000));
        const auto octave = static_cast<std::size_t>(std::bit_width(us));
        if (bars.size() <= octave) bars.resize(octave + 1);
        ++bars[octave];
    }
    const auto first = static_cast<std::size_t>(std::ranges::find_if(bars, [](int n) { return n > 0; }) - bars.begin());
    const int most = *std::ranges::max_element(bars);
    for (std::size_t k = first; k < bars.size(); ++k) {
        const std::uint64_t from = k == 0 ? 0 : std::uint64_t{1} << (k - 1), to = std::uint64_t{1} << k;
        out += fmt::format("  {:>7} to {:>7} us  {:<40} {}\n", from, to,
                           std::string(static_cast<std::size_t>((bars[k] * 40 + most - 1) / most), '#'), bars[k]);
    }
    return out;
}

std::string line_of(const char* file) {
    std::ifstream in(file);
    std::string line;
    std::getline(in, line);
    return line.empty() ? "unknown" : line;
}

// What decides the numbers, as far as a program can see it.
std::string machine_text() {
    utsname system{};
    uname(&system);
    const std::string version = system.version;
    const char* preemption = version.find("PREEMPT_RT") != std::string::npos ? "fully preemptible (PREEMPT_RT)"
        : version.find("PREEMPT_DYNAMIC") != std::string::npos
        ? "PREEMPT_DYNAMIC: chosen at boot (preempt=), which a program cannot see"
        : version.find("PREEMPT") != std::string::npos ? "preemptible (PREEMPT)"
                                                       : "not said by the kernel: probably none or voluntary";
    return fmt::format(
        "machine: {} processors for this program, Linux {}\nkernel preemption: {}\nclock source: {} (hpet and acpi_pm "
        "take a microsecond a read)\nprocessor speed governor: {}\n",
        std::thread::hardware_concurrency(), system.release, preemption,
        line_of("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        line_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"));
}

// ---- what stands behind the drivers when there are no devices

// A line that nobody sees: the strobe's thread works for it as for a real one.
class NoLine final : public drivers::GpioOutputs {
    Result<void> set(std::uint32_t) override { return {}; }
};

// Edges of a thread of this program: it sleeps, takes the time, and rings.
class EdgeThread {
  public:
    explicit EdgeThread(const hal::Clock& clock) : clock_(clock), bell_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
        sem_init(&wanted_, 0, 0);
        thread_ = std::thread([this] { run(); });
    }
    ~EdgeThread() {
        stopping_ = true;
        sem_post(&wanted_);
        thread_.join();
        sem_destroy(&wanted_);
    }
    EdgeThread(const EdgeThread&) = delete;
    EdgeThread& operator=(const EdgeThread&) = delete;
    [[nodiscard]] int bell() const { return bell_.get(); }
    void ask() { sem_post(&wanted_); }
    TimePoint answer() const {
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(bell_.get(), &count, sizeof count);
        return TimePoint(Duration(at_.load()));
    }

  private:
    void run() {
        std::minstd_rand random(1);
        for (;;) {
            while (sem_wait(&wanted_) != 0) continue;
            if (stopping_) return;
            std::this_thread::sleep_for(
                kApart + Duration(static_cast<std::int64_t>(random() % static_cast<unsigned>(kSpread.count()))));
            at_ = clock_.now().time_since_epoch().count();
            const std::uint64_t one = 1;
            [[maybe_unused]] const auto bytes = write(bell_.get(), &one, sizeof one);
        }
    }
    const hal::Clock& clock_;
    common::UniqueFd bell_;
    sem_t wanted_{};
    std::atomic<bool> stopping_{false};
    std::atomic<std::int64_t> at_{0};
    std::thread thread_;
};

// Inspects one frame over and over, under the normal policy, as the station's inspecting threads do.
class Work {
  public:
    Work(int threads, int bins_i, int bins_j) {
        for (int k = 0; k < threads; ++k) threads_.emplace_back([this, bins_i, bins_j] { run(bins_i, bins_j); });
    }
    ~Work() {
        stopping_ = true;
        for (std::thread& thread : threads_) thread.join();
    }
    Work(const Work&) = delete;
    Work& operator=(const Work&) = delete;
    [[nodiscard]] int frames() const { return frames_; }

  private:
    void run(int bins_i, int bins_j) {
        const sched_param normal{};
        sched_setscheduler(0, SCHED_OTHER, &normal);
        const algo::Extents extents{111, 111, bins_i, bins_j};
        Frame frame(extents.width_px(), extents.height_px(), 8);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x) {
                const double dx = x % bins_i - (bins_i - 1) / 2.0 + (x - y) * 1e-3,
                             dy = y % bins_j - (bins_j - 1) / 2.0;
                frame.set(x, y, static_cast<std::uint32_t>(200 * std::exp(-(dx * dx + dy * dy))));
            }
        }
        auto pipeline = algo::Pipeline::create(extents, 8, algo::Recipe{});
        while (pipeline && !stopping_) {
            if (!pipeline->inspect(frame.view())) break;
            ++frames_;
        }
    }
    std::atomic<bool> stopping_{false};
    std::atomic<int> frames_{0};
    std::vector<std::thread> threads_;
};

// ---- the measurement

class Measurement final : hal::Strobe::Listener, hal::Rejector::Listener, hal::PartSensor::Listener {
  public:
    Measurement(const LatencyOptions& options, const Config& config) : options_(options), config_(config) {}

    Exit go() {
        auto loop = SdEventLoop::open();
        if (!loop) return complain(loop.error());
        loop_ = std::move(*loop);
        if (auto done = loop_->stop_on_signals(); !done) return complain(done.error());
        std::string policy = "timing threads under the normal policy (--priority 0)";
        if (options_.priority > 0) {
            const auto refused = take_realtime_policy(options_.priority);
            policy = refused.empty()
                ? fmt::format("timing threads under SCHED_FIFO {}, memory locked", options_.priority)
                : std::string();
            for (const Error& error : refused) policy += (policy.empty() ? "" : "\npolicy: ") + error.message();
        }
        if (auto opened = open(); !opened) return complain(opened.error());
        fmt::print("{}policy: {}\nedges: {}\nlight: {}\nrejector: {}\n\n", machine_text(), policy, edges_text_,
                   light_text_, rejector_text_);
        Exit status = Exit::good;
        for (const bool busy : {false, true}) {
            if (!measure(busy)) status = Exit::unfit;
            if (loop_->stopped_by() != 0) break;
        }
        close_all();
        fmt::print(
            "What this cannot see: {}the light driver's and the valve's own delay, and what happens once a day. A "
            "machine that shall keep its times is measured for hours.\n",
            options_.sensor ? "" : "the interrupt and the kernel's way from a pin to the program, ");
        return status;
    }

  private:
    Result<void> open() {
        if (auto done = open_light(); !done) return done;
        if (auto done = open_rejector(); !done) return done;
        if (auto done = strobe_->start(*this); !done) return done;
        if (auto done = rejector_->start(*this); !done) return done;
        run_until([&] { return link_up_; }, std::chrono::seconds(5));
        if (!link_up_)
            return fail(ErrorCode::timeout, "the rejector does not answer: " + why_down_.what, why_down_.cure);
        return open_edges();
    }

    Result<void> open_light() {
        if (!options_.simulate && !config_.strobe.gpio.empty()) {
            auto opened = drivers::GpioStrobe::open(*loop_, config_.strobe.gpio);
            if (!opened) return tl::unexpected(opened.error());
            strobe_ = std::move(*opened);
            light_text_ = fmt::format("the configured GPIO lines (libgpiod {}), {:.3f} ms a pulse",
                                      drivers::gpiod_version(), static_cast<double>(pulse().count()) / 1e6);
            return {};
        }
        auto opened = drivers::GpioStrobe::open(
            *loop_, {{.max_on = milliseconds(2), .min_rest = microseconds(100), .max_duty = 1}},
            [] { return Result<std::unique_ptr<drivers::GpioOutputs>>(std::make_unique<NoLine>()); });
        if (!opened) return tl::unexpected(opened.error());
        strobe_ = std::move(*opened);
        light_text_ = "the strobe driver's own thread, without a GPIO line behind it";
        return {};
    }
    [[nodiscard]] Duration pulse() const { return std::min(kPulse, strobe_->limits().max_on); }

    Result<void> open_rejector() {
        const auto* wanted = std::get_if<drivers::ModbusRejectorOptions>(&config_.rejector);
        drivers::ModbusRejectorOptions options;
        if (!options_.simulate && options_.actuate && wanted != nullptr) {
            options = *wanted;
            rejector_text_ = "the configured module: the ejector moves";
        } else {
            auto module = sim::CoilModule::open(*loop_, {.realtime = options_.priority});
            if (!module) return tl::unexpected(module.error());
            module_ = std::move(*module);
            module_->on_coil([this](int coil, bool on, TimePoint at) {
                if (coil == 0 && on) moved_at_ = at.time_since_epoch().count();
            });
            options.address.port = module_->port();
            options.response_timeout = milliseconds(500);
            rejector_text_ = "a Modbus TCP module on loopback (another thread of this program)";
        }
        rejector_ = std::make_unique<drivers::ModbusRejector>(*loop_, options);
        return {};
    }

    Result<void> open_edges() {
        const auto* line = std::get_if<drivers::GpioPartSensorOptions>(&config_.part_sensor);
        if (options_.sensor) {
            if (line == nullptr)
                return fail(ErrorCode::invalid_argument, "--sensor needs a part sensor on a GPIO line",
                            "name a configuration with [part_sensor] backend = \"gpio\"");
            auto opened = drivers::GpioPartSensor::open(*loop_, *line);
            if (!opened) return tl::unexpected(opened.error());
            part_sensor_ = std::move(*opened);
            edges_text_ = fmt::format(
                "the part sensor on {} line {}, stamped by the kernel; its debounce of {:.0f} us is in every number",
                line->line.chip, line->line.line, static_cast<double>(line->debounce.count()) / 1e3);
            return part_sensor_->start(*this);
        }
        edge_thread_ = std::make_unique<EdgeThread>(*loop_);
        edges_text_ = "a thread of this program: no interrupt, no GPIO";
        auto watched = loop_->watch(edge_thread_->bell(), hal::EventLoop::Readiness::readable,
                                    [this] { begin(edge_thread_->answer()); });
        if (!watched) return tl::unexpected(watched.error());
        watch_ = *watched;
        return {};
    }

    void close_all() {
        if (edge_thread_) loop_->unwatch(watch_);
        edge_thread_.reset();
        if (part_sensor_) part_sensor_->stop();
        rejector_->stop();
        strobe_->stop();
    }

    bool measure(bool busy) {
        const char* load = busy ? "pipeline busy" : "idle";
        at_once_ = {fmt::format("edge to light, as soon as possible, {}", load), {}, 0};
        planned_ = {fmt::format("planned light, late by, {}", load), {}, 0};
        command_ = {fmt::format("edge to reject command at the module, {}", load), {}, 0};
        acknowledged_ = {fmt::format("edge to reject command acknowledged and read back, {}", load), {}, 0};
        done_ = 0;
        std::unique_ptr<Work> work;
        if (busy)
            work = std::make_unique<Work>(config_.inspection.threads, config_.inspection.bins_i,
                                          config_.inspection.bins_j);
        progress_ = std::make_unique<Progress>(load);
        next();
        const auto ran = loop_->run();
        progress_.reset();
        for (const Series* series : {&at_once_, &planned_, module_ ? &command_ : nullptr, &acknowledged_}) {
            if (series != nullptr) fmt::print("{}\n", text_of(*series));
        }
        if (work) fmt::print("{} frames were inspected meanwhile\n\n", work->frames());
        return ran.has_value() && !lost_;
    }

    void next() {
        if (done_ == options_.edges || lost_) return loop_->request_stop();
        if (progress_) progress_->show(static_cast<double>(done_) / options_.edges);
        waiting_ = true;
        if (edge_thread_) edge_thread_->ask();
    }

    // An edge: every second one lights at once, the others as a station does, at a time that was planned.
    void begin(TimePoint edge) {
        if (!std::exchange(waiting_, false)) return;
        edge_ = edge;
        plan_ = done_ % 2 == 0 ? std::nullopt : std::optional(edge + kAhead);
        lit_ = rejected_ = false;
        ++number_;
        moved_at_ = 0;
        const auto fired = strobe_->fire(
            {.exposure = number_, .channels = 1, .start = plan_.value_or(loop_->now()), .width = pulse()});
        if (!fired) {
            lit_ = true;
            ++series_of_light().missed;
        }
        const auto taken = rejector_->reject({number_, loop_->now(), kRejectWindow});
        if (!taken) {
            rejected_ = true;
            ++acknowledged_.missed;
            ++command_.missed;
        }
        overdue_ = loop_->call_after(kGivenUp, [this] {
            if (!lit_) ++series_of_light().missed;
            if (!rejected_) ++acknowledged_.missed, ++command_.missed;
            settle(true, true);
        });
        settle(false, false);
    }
    Series& series_of_light() { return plan_ ? planned_ : at_once_; }

    void settle(bool light, bool reject) {
        lit_ = lit_ || light;
        rejected_ = rejected_ || reject;
        if (!lit_ || !rejected_ || overdue_ == hal::EventLoop::TimerId::none) return;
        loop_->cancel(std::exchange(overdue_, hal::EventLoop::TimerId::none));
        ++done_;
        next();
    }

    void on_strobe(const hal::StrobeReport& report) override {
        if (report.exposure != number_ || lit_) return;
        if (report.lit) series_of_light().samples.push_back(report.start - plan_.value_or(edge_));
        else ++series_of_light().missed;
        settle(true, false);
    }
    void on_strobe_lost(const Error& error) override { lose(error); }
    void on_reject(const hal::RejectReport& report) override {
        if (report.part != number_ || rejected_) return;
        const TimePoint moved{Duration(moved_at_.load())};
        if (report.outcome == hal::RejectReport::Outcome::failed) ++acknowledged_.missed;
        else acknowledged_.samples.push_back(report.at - edge_);
        if (moved == TimePoint()) ++command_.missed;
        else command_.samples.push_back(moved - edge_);
        settle(false, true);
    }
    void on_rejector_link(bool up, const Error& why) override {
        link_up_ = up;
        if (!up) why_down_ = why;
    }
    void on_edge(const hal::PartEdge& edge) override {
        if (edge.kind == hal::PartEdge::Kind::arrives) begin(edge.at);
    }
    void on_encoder(const hal::EncoderReading&) override {}
    void on_part_sensor_lost(const Error& error) override { lose(error); }
    void lose(const Error& error) {
        lost_ = true;
        complain(error);
        loop_->request_stop();
    }

    void run_until(const std::function<bool()>& done, Duration patience) {
        const TimePoint give_up = loop_->now() + patience;
        const std::function<void()> look = [&] {
            if (done() || loop_->now() >= give_up) return loop_->request_stop();
            loop_->call_after(milliseconds(1), [&] { look(); });
        };
        loop_->post([&] { look(); });
        (void)loop_->run();
    }

    const LatencyOptions& options_;
    const Config& config_;
    std::unique_ptr<SdEventLoop> loop_;
    std::unique_ptr<sim::CoilModule> module_;
    std::unique_ptr<hal::Rejector> rejector_;
    std::unique_ptr<drivers::GpioStrobe> strobe_;
    std::unique_ptr<drivers::GpioPartSensor> part_sensor_;
    std::unique_ptr<EdgeThread> edge_thread_;
    std::unique_ptr<Progress> progress_;
    hal::EventLoop::WatchId watch_{};
    std::string edges_text_, light_text_, rejector_text_;
    Series at_once_, planned_, command_, acknowledged_;
    std::atomic<std::int64_t> moved_at_{0};  // when the module's coil moved; 0: not yet
    TimePoint edge_{};
    std::optional<TimePoint> plan_;
    std::uint32_t number_ = 0;
    int done_ = 0;
    bool waiting_ = false, lit_ = false, rejected_ = false, link_up_ = false, lost_ = false;
    Error why_down_;
    hal::EventLoop::TimerId overdue_{};
};

Exit measure_latency(const LatencyOptions& options) {
    Config config;
    if (!options.config.empty()) {
        auto loaded = load_config(options.config);
        if (!loaded) return complain(loaded.error());
        config = std::move(*loaded);
    }
    if (options.config.empty() && !options.simulate) {
        return complain({ErrorCode::invalid_argument, "latency needs --config FILE or --simulate",
                         "--simulate measures this machine without any device"});
    }
    return Measurement(options, config).go();
}

}  // namespace

void add_latency(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "latency", "Measure on this machine: edge to light, edge to reject command, idle and with the pipeline busy");
    auto options = std::make_shared<LatencyOptions>();
    command->add_option("--config", options->config,
                        "Pulse the lights that this configuration names; the service must not run");
    command->add_flag("--simulate", options->simulate,
                      "No device: the drivers with nothing behind them, and a Modbus module on loopback");
    command->add_flag("--sensor", options->sensor,
                      "Edges of the configured part sensor, as parts pass it, instead of a thread's");
    command->add_flag("--actuate", options->actuate,
                      "Commands to the configured module: the ejector moves, only with the line clear");
    command->add_option("--edges", options->edges, "How many, idle and busy each")
        ->check(CLI::Range(2, 10'000'000))
        ->capture_default_str();
    command
        ->add_option("--priority", options->priority,
                     "Real-time priority of the timing threads, as the service has it; 0: none")
        ->check(CLI::Range(0, 99))
        ->capture_default_str();
    command->footer(
        "Exit status: 0 measured, 2 a device is not there, 3 a device was lost.\nExample: hordctl latency --simulate "
        "--edges 2000");
    command->callback([options, &status] { status = measure_latency(*options); });
}

}  // namespace hord::firmware
