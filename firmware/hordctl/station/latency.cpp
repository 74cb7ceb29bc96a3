// hordctl latency: measures, on this machine, the time from a part sensor's edge to the light and to the reject
// command, idle and with the pipeline busy. The drivers are the station's; the report names the devices behind them.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <semaphore>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "algo/inspection/pipeline.h"
#include "common/assign.h"
#include "common/cli/progress.h"
#include "common/unique_fd.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/gpio/gpio_part_sensor.h"
#include "drivers/gpio/gpio_strobe.h"
#include "drivers/modbus/modbus_rejector.h"
#include "firmware/config/config.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/latency_report.h"
#include "firmware/service/realtime.h"
#include "hal_sim/coil_module/coil_module.h"

namespace hord::firmware {
namespace {

using hal::TimePoint;

constexpr Duration kPulse = milliseconds(1);  // of the light
constexpr Duration kAhead = milliseconds(3);  // from the edge to a planned pulse
constexpr Duration kRejectWindow = milliseconds(4);
constexpr Duration kApart = milliseconds(12), kSpread = milliseconds(10);  // from one edge's end to the next one
constexpr Duration kReportTimeout = milliseconds(1000);                    // of all reports on one edge

struct LatencyOptions {
    std::string config;
    bool simulate = false, actuate = false, sensor = false;
    int edges = 2000, priority = 20;  // as hordd.service
};

// ---- substitutes for devices

// A GPIO line without hardware: the strobe's thread does the same work for it.
class NullLine final : public drivers::GpioOutputs {
    Result<void> set(std::uint32_t) override { return {}; }
};

// Makes edges in a thread of its own: sleeps, stores the time, and signals an eventfd.
class EdgeThread {
  public:
    explicit EdgeThread(const hal::Clock& clock) : clock_(clock), event_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
        thread_ = std::thread([this] { run(); });
    }
    ~EdgeThread() {
        stopping_ = true;
        wanted_.release();
        thread_.join();
    }
    [[nodiscard]] int event_fd() const { return event_fd_.get(); }
    void ask() { wanted_.release(); }
    TimePoint answer() const {
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(event_fd_.get(), &count, sizeof count);
        return TimePoint(Duration(at_.load()));
    }

  private:
    void run() {
        std::minstd_rand random(1);
        for (;;) {
            wanted_.acquire();
            if (stopping_) return;
            std::this_thread::sleep_for(
                kApart + Duration(static_cast<std::int64_t>(random() % static_cast<unsigned>(kSpread.count()))));
            at_ = clock_.now().time_since_epoch().count();
            const std::uint64_t one = 1;
            [[maybe_unused]] const auto bytes = write(event_fd_.get(), &one, sizeof one);
        }
    }
    const hal::Clock& clock_;
    common::UniqueFd event_fd_;
    std::counting_semaphore<> wanted_{0};
    std::atomic<bool> stopping_{false};
    std::atomic<std::int64_t> at_{0};
    std::thread thread_;
};

// Load: inspects one frame again and again, under the normal policy, as the station's inspection threads do.
class InspectionLoad {
  public:
    InspectionLoad(int threads, int bins_i, int bins_j) {
        for (int k = 0; k < threads; ++k) {
            threads_.emplace_back([this, bins_i, bins_j](const std::stop_token& ends) { run(ends, bins_i, bins_j); });
        }
    }
    [[nodiscard]] int frames() const { return frames_; }

  private:
    void run(const std::stop_token& ends, int bins_i, int bins_j) {
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
        algo::Recipe recipe;
        recipe.part_required = false;  // the frame is judged, although it shows no part
        auto pipeline = algo::Pipeline::create(extents, 8, recipe);
        while (pipeline && !ends.stop_requested() && pipeline->inspect(frame.view())) ++frames_;
    }
    std::atomic<int> frames_{0};
    std::vector<std::jthread> threads_;  // ends with it
};

// ---- the measurement

class Measurement final : hal::Strobe::Listener, hal::Rejector::Listener, hal::PartSensor::Listener {
  public:
    Measurement(const LatencyOptions& options, const Config& config) : options_(options), config_(config) {}

    Exit run() {
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
        fmt::print(
            "{}policy: {}\nedges: {}, {} idle and busy each\nlight: {}; at once after every other edge, planned "
            "after the others\nrejector: {}, after every edge\n\n",
            machine_text(), policy, edges_text_, options_.edges, light_text_, rejector_text_);
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
        if (!loop_->run_until([&] { return link_up_; }, std::chrono::seconds(5)))
            return fail(ErrorCode::timeout, "the rejector's link does not come up: " + why_down_.what, why_down_.cure);
        return open_edges();
    }

    Result<void> open_light() {
        if (!options_.simulate && !config_.strobe.gpio.empty()) {
            if (auto done = assign(strobe_, drivers::GpioStrobe::open(*loop_, config_.strobe.gpio)); !done) return done;
            light_text_ = fmt::format("the configured GPIO lines (libgpiod {}), {:.3f} ms a pulse",
                                      drivers::gpiod_version(), static_cast<double>(pulse().count()) / 1e6);
            return {};
        }
        light_text_ = "the strobe driver's own thread, without a GPIO line behind it";
        return assign(strobe_,
                      drivers::GpioStrobe::open(
                          *loop_, {{.max_on = milliseconds(2), .min_rest = microseconds(100), .max_duty = 1}},
                          [] { return Result<std::unique_ptr<drivers::GpioOutputs>>(std::make_unique<NullLine>()); }));
    }
    [[nodiscard]] Duration pulse() const { return std::min(kPulse, strobe_->limits().max_on); }

    Result<void> open_rejector() {
        const auto* wanted = std::get_if<drivers::ModbusRejectorOptions>(&config_.rejector);
        drivers::ModbusRejectorOptions options;
        if (!options_.simulate && options_.actuate && wanted != nullptr) {
            options = *wanted;
            rejector_text_ = "the configured module: the ejector moves";
        } else {
            if (auto done = assign(module_, sim::CoilModule::open(*loop_, options_.priority)); !done) return done;
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
            if (auto done = assign(part_sensor_, drivers::GpioPartSensor::open(*loop_, *line)); !done) return done;
            edges_text_ = fmt::format(
                "the part sensor on {} line {}, stamped by the kernel; its debounce of {:.0f} us is in every number",
                line->line.chip, line->line.line, static_cast<double>(line->debounce.count()) / 1e3);
            return part_sensor_->start(*this);
        }
        edge_thread_ = std::make_unique<EdgeThread>(*loop_);
        edges_text_ = "a thread of this program: no interrupt, no GPIO";
        return assign(watch_, loop_->watch(edge_thread_->event_fd(), hal::EventLoop::Readiness::readable, [this] {
            begin(edge_thread_->answer());
        }));
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
        std::unique_ptr<InspectionLoad> work;
        if (busy)
            work = std::make_unique<InspectionLoad>(config_.inspection.threads, config_.inspection.bins_i,
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

    // Odd and even edges alternate: light at once, and light at a planned time, as a station does.
    void begin(TimePoint edge) {
        if (!std::exchange(waiting_, false)) return;
        edge_ = edge;
        plan_ = done_ % 2 == 0 ? std::nullopt : std::optional(edge + kAhead);
        lit_ = rejected_ = false;
        ++number_;
        moved_at_ = 0;
        const hal::StrobePulse light{
            .exposure = number_, .channels = 1, .start = plan_.value_or(loop_->now()), .width = pulse()};
        if (!strobe_->fire(light)) light_came(std::nullopt);
        if (!rejector_->reject({number_, loop_->now(), kRejectWindow})) rejected(std::nullopt, std::nullopt);
        overdue_ = loop_->call_after(kReportTimeout, [this] {
            light_came(std::nullopt);
            rejected(std::nullopt, std::nullopt);
        });
        next_when_settled();
    }

    // The outcomes for an edge, once each; empty: missed.
    void light_came(std::optional<Duration> delay) {
        if (!std::exchange(lit_, true)) (plan_ ? planned_ : at_once_).add(delay);
        next_when_settled();
    }
    void rejected(std::optional<Duration> acknowledged, std::optional<Duration> moved) {
        if (!std::exchange(rejected_, true)) {
            acknowledged_.add(acknowledged);
            command_.add(moved);
        }
        next_when_settled();
    }
    void next_when_settled() {
        if (!lit_ || !rejected_ || overdue_ == hal::EventLoop::TimerId::none) return;
        loop_->cancel(std::exchange(overdue_, hal::EventLoop::TimerId::none));
        ++done_;
        next();
    }

    void on_strobe(const hal::StrobeReport& report) override {
        if (report.exposure != number_) return;
        light_came(report.lit ? std::optional(report.start - plan_.value_or(edge_)) : std::nullopt);
    }
    void on_strobe_lost(const Error& error) override { lose(error); }
    void on_reject(const hal::RejectReport& report) override {
        if (report.part != number_) return;
        const TimePoint moved{Duration(moved_at_.load())};
        rejected(report.outcome == hal::RejectReport::Outcome::failed ? std::nullopt : std::optional(report.at - edge_),
                 moved == TimePoint() ? std::nullopt : std::optional(moved - edge_));
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
    const auto config = options.config.empty() ? Config{} : load_config(options.config);
    if (!config) return complain(config.error());
    if (options.config.empty() && !options.simulate) {
        return complain({ErrorCode::invalid_argument, "latency needs --config FILE or --simulate",
                         "--simulate measures this machine without any device"});
    }
    return Measurement(options, *config).run();
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
    add_number(
        *command, "--edges", options->edges,
        "How many, idle and busy each; the light comes at once after every other one, as planned after the others", 2,
        10'000'000);
    add_number(*command, "--priority", options->priority,
               "Real-time priority of the timing threads, as the service has it; 0: none", 0, 99);
    command->footer(
        "Exit status: 0 measured, 2 a device is not there, 3 a device was lost.\nExample: hordctl latency --simulate "
        "--edges 2000");
    command->callback([options, &status] { status = measure_latency(*options); });
}

}  // namespace hord::firmware
