// hordctl run: the station in the foreground. On the simulated line the report compares verdicts with the true parts.
#include <algorithm>
#include <map>
#include <memory>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/cli/output.h"
#include "common/cli/progress.h"
#include "firmware/core/faults.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/gallery.h"
#include "firmware/hordctl/station/part_lines.h"
#include "firmware/hordctl/station/run_options.h"
#include "firmware/hordctl/station/run_report.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/registers/register_client.h"
#include "firmware/service/early_signals.h"
#include "firmware/service/realtime.h"
#include "firmware/service/service.h"
#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware {
namespace {

constexpr const char* kStoppedEarly = "hordctl: stopped as asked, before the line ran: no part came\n";

// Each fault with its meaning and cure.
std::vector<std::string> fault_lines(std::uint32_t faults, const LineStop& why) {
    std::vector<std::string> lines;
    for (const FaultInfo& fault : kFaultTable) {
        if ((faults & fault.bit) != 0) lines.push_back("FAULT " + text_of(fault, why));
    }
    return lines;
}

// One run: joins each part's result with its fate (simulated line), and ends when all parts have both.
class Run {
  public:
    explicit Run(const RunOptions& options) : options_(options) {}

    Exit go() {
        never_wait_for_stderr();
        end_at_signals(kStoppedEarly, true);
        auto config = config_of_run(options_);
        if (!config) return complain(config.error());
        auto files = read_station_files(*config);
        if (!files) return complain(files.error());
        if (!options_.store.empty()) {
            config->store.folder = options_.store;
            // A service goes on without its store; who names one here wants it. Rendering takes longer than this check.
            const auto lock = lock_store(*config);  // until the service takes it
            if (!lock) return complain(lock.error());
            if (auto usable = store::open_sqlite_store(options_.store); !usable) return complain(usable.error());
        }
        for (const auto& folder : {options_.out, options_.state}) {
            if (folder.empty()) continue;
            if (auto made = make_folder(folder); !made) return complain(made.error());
        }
        if (!options_.state.empty()) config->state_folder = options_.state;
        gallery_.set_bins(config->inspection.bins_i, config->inspection.bins_j);
        auto service = open(*config, std::move(*files));
        if (!service) return complain(service.error());
        service_ = std::move(*service);
        on_recipe(service_->recipe());
        print_message("registers at {}\nsimulated: {}\n", service_->registers_address(),
                      names_of_faults(service_->simulated()));
        progress_ = std::make_unique<Progress>("parts", options_.line.parts == 0);
        for (const auto& told : {start_notes(*config), missing_references(config->inspection.recipes)}) {
            for (const Error& note : told) say(note.message());
        }
        // Without an end of its own the run waits for a person who resets the line, as the service does.
        const bool ends = options_.line.parts > 0 || std::holds_alternative<FrameFolder>(config->sensor);
        if (ends || options_.reset_after_s > 0) watch_for_line_stop(0);
        if (!options_.vitals.empty()) service_->loop().post([this] { sample_vitals(); });
        if (options_.line.realtime > 0) {
            for (const Error& refused : take_realtime_policy(options_.line.realtime)) say(refused.message());
        }
        begun_ = service_->loop().now();
        const auto ran = service_->run();
        if (reader_.joinable()) reader_.join();
        if (!ran) return complain(ran.error());
        return finish();
    }

  private:
    Result<std::unique_ptr<Service>> open(const Config& config, StationFiles files) {
        SimulationOptions simulation = options_.line;
        simulation.own_coil_module = simulation.all_defects = options_.simulate;
        auto rendering = std::make_shared<std::unique_ptr<Progress>>(std::make_unique<Progress>(
            std::holds_alternative<FrameFolder>(config.sensor) ? "read frames" : "render parts"));
        simulation.progress = [rendering](double done) {
            if (*rendering) (*rendering)->show(done);
            if (done >= 1) rendering->reset();
        };
        if (options_.line.parts == 0) print_message("seed {}, until interrupted\n", options_.line.seed);
        else print_message("seed {}, {} parts\n", options_.line.seed, options_.line.parts);

        ServiceWatchers watchers;
        watchers.result = [this](const PartResult& result) { on_result(result); };
        watchers.fate = [this](const Backends::Fate& fate) { on_fate(fate); };
        watchers.line_over = [this] { on_line_over(); };
        watchers.state = [this](State from, State to) {
            say(fmt::format("{} to {}", name_of(from), name_of(to)));
            // Those that led to Error have been told; others are still active from before.
            const std::uint32_t told = std::exchange(told_, 0U);
            if (to == State::error && service_) tell(service_->snapshot().faults_active & ~told, {});
        };
        watchers.fault = [this](std::uint32_t raised, const Snapshot& now) {
            tell(raised, now.line_stop_why);
            told_ |= raised;
        };
        watchers.stopped_early = [rendering] {
            rendering->reset();
            write_message(kStoppedEarly);
        };
        watchers.trouble = [this](const Error& error) { say(error.message()); };
        watchers.recipe = [this](const NumberedRecipe& recipe) { on_recipe(recipe); };
        if (!options_.out.empty() || options_.json) {
            watchers.inspection = [this, bins = std::pair(config.inspection.bins_i, config.inspection.bins_j)](
                                      std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) {
                if (!options_.out.empty()) gallery_.keep(part, frame, inspection);
                if (!options_.json) return;
                const auto [i, j] = bins;
                lines_.keep(part, inspection, {frame.width_px / i, frame.height_px / j, i, j});
            };
        }
        return Service::open(config, std::move(files), simulation, std::move(watchers));
    }

    void on_recipe(const NumberedRecipe& recipe) {
        auto in_use = std::make_shared<const algo::Recipe>(recipe.recipe);
        gallery_.set_recipe(in_use);
        lines_.set_recipe(std::move(in_use));
    }

    void sample_vitals() {
        const Duration every = milliseconds(1000) * options_.vitals_every_s;
        service_->loop().call_after(every, [this] { sample_vitals(); });
        if (first_arrival_)
            vitals_.sample(
                std::chrono::duration<double>(service_->loop().now().time_since_epoch() - *first_arrival_).count());
    }

    void say(const std::string& line) {
        progress_.reset();
        print_message("hordctl: {}\n", line);
        progress_ = std::make_unique<Progress>("parts", options_.line.parts == 0);
    }

    void tell(std::uint32_t faults, const LineStop& why) {
        for (const std::string& line : fault_lines(faults, why)) say(line);
    }

    void on_result(const PartResult& result) {
        if (!first_arrival_) first_arrival_ = Duration(result.arrived_ns);
        last_seen_ = service_->loop().now();
        if (!options_.vitals.empty()) vitals_.add(result);
        results_[result.arrived_ns] = result;
        // A real line tells no fate. What a simulated rejector confirms has happened; of a real one `reject` says what
        // is known.
        if ((service_->simulated() & kFaultPartSensor) == 0) {
            Backends::Fate fate;
            fate.arrived = hal::TimePoint(Duration(result.arrived_ns));
            if ((service_->simulated() & kFaultRejector) != 0) fate.ejected = result.reject == RejectState::confirmed;
            on_fate(fate);
            if (settled_ == options_.line.parts) end();  // a real line brings more of them; 0: never
            return;
        }
        settle(result.arrived_ns);
    }
    void on_fate(const Backends::Fate& fate) {
        const std::int64_t arrived = fate.arrived.time_since_epoch().count();
        fates_[arrived] = fate;
        ++fated_;
        settle(arrived);
    }
    void on_line_over() {
        line_over_ = true;
        if (fated_ < options_.line.parts)
            say(fmt::format("the last recorded frame was played: {} of {} parts came", fated_, options_.line.parts));
        // Parts that the station never saw have a fate and no result: stop waiting after a while.
        service_->loop().call_after(milliseconds(2000), [this] { end(); });
        end_if_settled();
    }

    void end_if_settled() {
        if (line_over_ && fates_.empty() && results_.empty()) end();
    }

    // For a device that never started the station waits for ever, in no state of an error.
    static bool waits_for_device(const Snapshot& now) {
        return (now.state == State::preoperational || now.state == State::initialized) &&
            (now.faults_active & kDeviceFaults) != 0;
    }

    // A stopped line brings no more parts. With --reset-after it is reset as by a person; otherwise the run ends.
    void watch_for_line_stop(int seconds_stopped) {
        const Snapshot now = service_->snapshot();
        const bool waits = waits_for_device(now);
        int stopped = waits || now.line_stop || now.state == State::error ? seconds_stopped + 1 : 0;
        if (options_.reset_after_s > 0 && stopped > options_.reset_after_s) {
            stopped = 0;
            ++resets_;
            service_->reset_line();
        }
        if (options_.reset_after_s == 0 && stopped > (waits ? kWaitsForDevice : kWaitsForReset)) return end();
        service_->loop().call_after(milliseconds(1000), [this, stopped] { watch_for_line_stop(stopped); });
    }

    void settle(std::int64_t arrived) {
        const auto result = results_.find(arrived);
        const auto fate = fates_.find(arrived);
        if (result == results_.end() || fate == fates_.end()) return;
        report_.add(result->second, fate->second);
        if (options_.json) {
            if (const auto printed = lines_.print(result->second, fate->second); !printed)
                say(printed.error().message());
        }
        gallery_.settle(result->second.part, fate->second.kind, fate->second.look);
        ++settled_;
        if (options_.line.parts > 0 && progress_) {
            progress_->show(static_cast<double>(settled_) / static_cast<double>(options_.line.parts),
                            fmt::format("{} parts", settled_));
        }
        results_.erase(result);
        fates_.erase(fate);
        end_if_settled();
    }

    // Halts. The parts that are on the line get their results, and nobody sees their way off it any more.
    void settle_the_rest() {
        ending_ = true;
        service_->halt();
        for (const auto& [arrived, result] : std::exchange(results_, {})) {
            results_[arrived] = result;
            Backends::Fate fate;
            fate.arrived = hal::TimePoint(Duration(arrived));
            fate.on_line = true;
            on_fate(fate);
        }
    }

    // Reads the counters as a PLC would, over the network, while the station still runs; then stops it.
    void end() {
        if (ending_) return;
        ending_ = true;
        last_snapshot_ = service_->snapshot();
        reader_ = std::thread([this] {
            auto endpoint = modbus::parse_endpoint(service_->registers_address());
            auto client = endpoint ? modbus::Client::connect(*endpoint, std::chrono::milliseconds(1000))
                                   : tl::unexpected(endpoint.error());
            counters_ = client ? client->read_block(BlockId::counters) : tl::unexpected(client.error());
            service_->stop();
        });
    }

    // The reader of the report may take nothing: the station has ended before.
    Exit finish() {
        std::string report;
        const Exit end = close(report);
        // Where that cannot be written, no message can; the status is all that is left.
        if (options_.json) return write_message(report) ? end : Exit::bad_input;
        const Written written = write_output(report, kWaitsForReader);
        if (written.bytes == report.size()) return end;
        return complain(written.reason != 0
                            ? lost_output(written.reason)
                            : Error{ErrorCode::io, "the report could not be written: its reader does not take it",
                                    "let the reader go on, or read the store"});
    }

    Exit close(std::string& report) {
        if (!ending_) last_snapshot_ = service_->snapshot();
        const bool waited = ending_ || service_->loop().now() - begun_ >= milliseconds(1000) * kWaitsForDevice;
        settle_the_rest();
        if (const auto printed = lines_.finish(kWaitsForReader); !printed) say(printed.error().message());
        progress_.reset();
        const Duration elapsed = last_seen_.time_since_epoch() - first_arrival_.value_or(Duration::zero());
        const auto print = [&report](const std::string& text) { report += text; };
        print(fmt::format("\n{}", report_.parts() > 0 ? report_.text(elapsed) : std::string("no part came\n")));
        if (options_.reset_after_s > 0) print(fmt::format("the line was stopped and reset {} times\n", resets_));
        if (!options_.vitals.empty()) {
            print(vitals_.text());
            if (auto written = vitals_.write(options_.vitals); !written) return complain(written.error());
        }
        if (counters_) {
            print("\ncounters, read over Modbus:");
            for (const Reading& reading : *counters_) print(fmt::format(" {} {}", reading.what->name, reading.text));
            print("\n");
        }
        Result<std::string> picture;
        if (!options_.out.empty()) {
            picture = gallery_.write(options_.out, [this](std::size_t look) {
                return service_->telecentric_view(look).value_or(std::vector<float>());
            });
        }
        const std::vector<Error> lost = service_->close();
        for (const Error& error : lost) print_message("hordctl: {}\n", error.message());
        const Snapshot& last = *last_snapshot_;
        // A device that is not there yet is no error of a run that was stopped early.
        const bool stands = last.line_stop || last.state == State::error || (waited && waits_for_device(last));
        if (stands) {
            print(fmt::format("the station ended in {}{}\n", name_of(last.state),
                              last.line_stop ? ", line stop raised" : ""));
            for (const std::string& fault : fault_lines(last.faults_active | last.faults_latched, last.line_stop_why))
                print(fmt::format("{}\n", fault));
        }
        if (!picture) return complain(picture.error());
        if (!options_.out.empty()) print(fmt::format("picture: {}\n", *picture));
        if (stands || !lost.empty()) return Exit::unfit;
        return lines_.lost() ? Exit::bad_input : Exit::good;
    }

    static constexpr int kWaitsForReset = 5, kWaitsForDevice = 10;  // seconds
    static constexpr int kWaitsForReader = 2000;                    // ms, of --json and of the report, at the end

    const RunOptions& options_;
    std::unique_ptr<Service> service_;
    std::unique_ptr<Progress> progress_;
    RunReport report_;
    ResourceMonitor vitals_;
    Gallery gallery_;
    PartLines lines_;
    std::map<std::int64_t, PartResult> results_;  // by arrival, until their fate is known
    std::map<std::int64_t, Backends::Fate> fates_;
    std::size_t settled_ = 0, fated_ = 0, resets_ = 0;
    std::uint32_t told_ = 0;                 // FaultBits, since the last change of state
    std::optional<Duration> first_arrival_;  // since the loop's epoch
    hal::TimePoint begun_{}, last_seen_{};
    bool line_over_ = false, ending_ = false;
    std::optional<Snapshot> last_snapshot_;
    std::thread reader_;
    Result<std::vector<Reading>> counters_ = tl::unexpected(Error{});
};

}  // namespace

void add_run(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("run", "Run the station in the foreground (what hordd does)");
    auto options = std::make_shared<RunOptions>();
    command->add_option("--config", options->config,
                        "Configuration (TOML, deploy/hordd.toml); with --simulate it may be left out");
    auto* simulate =
        command->add_flag("--simulate", options->simulate,
                          "Simulated line and sensor, and a Modbus coil module on loopback as the rejector");
    command->add_option("--modbus", options->modbus,
                        "Where the register server listens, HOST:PORT (port 0: any free one), instead of what the "
                        "configuration says; who may read and write is as configured");
    command->add_option("--parts", options->line.parts,
                        "End after so many parts; of recorded frames at most one a frame; 0, or without it: run until "
                        "interrupted, or until the last recorded frame");
    command->add_option("--seed", options->line.seed, "Seed of the simulated line")->capture_default_str();
    options->line.parts_per_second = 10;
    auto* const rate =
        add_number(*command, "--rate", options->line.parts_per_second,
                   "Parts a second on the simulated line; unless given, fewer with a --config whose line.min_gap_ms is "
                   "above 50",
                   0.1, 1000.0);
    auto* const good =
        add_number(*command, "--good", options->line.good_share, "Share of good parts on the simulated line", 0.0, 1.0);
    auto* const variety =
        add_number(*command, "--variety", options->line.variety,
                   "Different parts of each kind on the simulated line; each is rendered at the start", 1, 1000);
    command->add_option("--out", options->out,
                        "Folder for a picture of one part of each kind: what a telecentric camera would have seen, the "
                        "transmission, and the map that decided");
    command->add_option(
        "--store", options->store,
        "Folder to keep results and frames in (docs/store.md); without it, what the configuration says");
    command->add_option("--state", options->state,
                        "State folder, as the service's: keeps the recipe in use, what was taught (docs/plc.md) and "
                        "the store for the next run; without it nothing is kept");
    add_number(*command, "--realtime", options->line.realtime,
               "Run the timing thread under SCHED_FIFO with this priority, as the service does; 0: not", 0, 99);
    command->add_option(
        "--vitals", options->vitals,
        "CSV file for latencies, memory, descriptors and processor time over the run; the report shows them, too");
    add_number(*command, "--vitals-every", options->vitals_every_s, "Seconds a line of it", 1, 3600);
    add_number(*command, "--reset-after", options->reset_after_s,
               "Seconds after which a station that stopped the simulated line is reset and the parts are taken off, as "
               "a person would; 0: it stays stopped",
               0, 3600)
        ->needs(simulate);  // a real line is reset by a person only
    command->add_flag("--json", options->json, "Print one JSON object a part; the report goes to stderr");
    command->footer(
        "Exit status: 0 every part that came got its verdict, 2 bad configuration, a port or a state folder that "
        "another "
        "station uses, or output that could not be written, 3 the station ended in an error, or results or frames "
        "could not be stored. With --parts or recorded frames it ends by itself when the line is stopped, or the "
        "station in an error, for 5 s, or a device is not there for 10 s.\n"
        "Example: hordctl run --simulate --parts 200 --modbus 127.0.0.1:1502");
    command->callback([options, rate, good, variety, &status] {
        options->good_given = good->count() > 0;
        options->variety_given = variety->count() > 0;
        if (!options->config.empty() && rate->count() == 0) options->line.parts_per_second = 0;
        status = Run(*options).go();
    });
}

}  // namespace hord::firmware
