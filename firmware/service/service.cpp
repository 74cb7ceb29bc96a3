// Opens a service and runs it. Its first recipe: service_recipe.cpp; the events of a running one: service_events.cpp;
// reload: service_reload.cpp.
#include "firmware/service/service.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <random>

#include <fmt/format.h>

#include "common/assign.h"
#include "firmware/diagnostics/inspection_self_test.h"
#include "firmware/diagnostics/learn_report.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/service/early_signals.h"

namespace hord::firmware {
namespace {

constexpr Duration kBeltStops = milliseconds(200);  // from the end of the run permit

constexpr std::initializer_list<int> kEndSignals = {SIGINT, SIGTERM, SIGQUIT};

// The event loop takes these signals when it runs, and every thread has them blocked. One that came meanwhile waits.
bool stop_waits(bool hangup_stops) {
    sigset_t waiting;
    ::sigpending(&waiting);
    const auto waits = [&](int signal) { return ::sigismember(&waiting, signal) == 1; };
    return std::ranges::any_of(kEndSignals, waits) || (hangup_stops && waits(SIGHUP));
}

StationIdentity identity_of(const Config& config, const SimulationOptions& simulation) {
    StationIdentity identity;
    identity.firmware = HORD_VERSION;
    identity.serial = config.name;
    identity.simulated = simulated_devices(config, simulation);
    // The low half must not be 0: in a command's `boot` that means any boot.
    while ((identity.boot_id & 0xFFFFU) == 0) identity.boot_id = std::random_device{}();
    return identity;
}

std::int64_t steady_ns() { return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

algo::InspectionLimits limits_of(const InspectionConfig& inspection) {
    algo::InspectionLimits limits;
    limits.time_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(inspection.budget).count();
    return limits;
}

Result<void> write_report(const LearnedParts& learned) {
    const auto report = check_learned(learned);
    if (!report) return tl::unexpected(report.error());
    return write_learn_report(*report).map([](const auto&) {});
}

}  // namespace

void Service::prepare_registers() {
    command_handler_.emplace();
    plc_interface_.emplace(*loop_, *command_handler_,
                           PlcOptions{config_.core.plc_policy, config_.plc.timeout, identity_.boot_id});
    registers_.emplace(identity_, &*plc_interface_);
}

// Requests are answered only when the loop runs.
Result<void> Service::open_servers() {
    modbus::ServerOptions options;
    options.host = config_.modbus.host;
    options.port = config_.modbus.port;
    options.max_connections = config_.modbus.max_connections;
    options.access = config_.modbus.access;
    const auto listen = [&](int socket) {
        return socket >= 0 ? modbus::Server::adopt(*loop_, *registers_, socket, options)
                           : modbus::Server::open(*loop_, *registers_, options);
    };
    if (auto done = assign(server_, listen(sockets_.modbus)); !done) return done;
    if (config_.modbus.read_only_port != 0 || sockets_.modbus_read_only >= 0) {
        options.port = config_.modbus.read_only_port;
        options.may_write = false;
        if (auto done = assign(read_only_server_, listen(sockets_.modbus_read_only)); !done) return done;
    }
    if (config_.serial) {
        auto line = modbus::RtuServer::open(*loop_, *registers_, *config_.serial);
        if (auto done = assign(serial_server_, std::move(line)); !done) return done;
    }
    return {};
}

void Service::close_servers() {
    serial_server_.reset();
    read_only_server_.reset();
    server_.reset();
}

// Takes the calibration in use, and returns the size of the light field.
Result<algo::Extents> Service::open_grid(const hal::SensorFormat& format) {
    if (grid_) {
        const auto kept = kept_calibration(config_.state_folder);
        if (auto fits = check_calibration(*grid_, kept, format); !fits) return tl::unexpected(fits.error());
        if (const auto told = other_camera(*grid_, kept)) on_trouble(*told);
        if (!kept.empty()) {
            if (auto done = calib::write_grid(kept, grid_->file); !done) return tl::unexpected(done.error());
        }
        const calib::GridStatistics& s = grid_->file.statistics;
        calibration_.id = grid_->crc32;
        calibration_.residual_px = std::sqrt(0.5 * (s.rms_x_px * s.rms_x_px + s.rms_y_px * s.rms_y_px));
    }
    return light_field_of(config_.inspection, grid_, format);
}

Result<void> Service::open_inspector(const NumberedRecipe& recipe, const algo::Extents& extents) {
    const hal::SensorFormat format = backends_->sensor().format();
    const InspectorSettings settings{.extents = extents,
                                     .bits = format.bits,
                                     .decoder = grid_ ? grid_->decoder : nullptr,
                                     .recipe = recipe.recipe,
                                     .recipe_number = recipe.number,
                                     .threads = config_.inspection.threads,
                                     .queue = config_.inspection.queue,
                                     .observer = this,
                                     .now = config_.inspection.budget.count() > 0 ? steady_ns : nullptr,
                                     .limits = limits_of(config_.inspection)};
    if (auto done = assign(inspector_, make_threaded_inspector(*loop_, settings)); !done)
        return tl::unexpected(done.error());
    const auto zero = grid_ ? algo::DriftZero::calibration : algo::DriftZero::first_parts;
    auto drift_monitor = DriftMonitor::create(extents, algo::light_levels(recipe.recipe, format.bits), zero,
                                              grid_ ? grid_->decoder->bin_px() : 1);
    if (auto done = assign(drift_, std::move(drift_monitor)); !done) return tl::unexpected(done.error());
    auto optics_monitor = OpticsMonitor::create(extents, limits_of(config_.optics, format.bits));
    if (auto done = assign(optics_, std::move(optics_monitor)); !done) return tl::unexpected(done.error());
    calibration_.lenslets_m = static_cast<std::uint16_t>(extents.m);
    calibration_.lenslets_n = static_cast<std::uint16_t>(extents.n);
    publish_calibration();
    if (!config_.state_folder.empty()) {
        teach_in_ = std::make_unique<LineTeachIn>(
            *loop_,
            TeachInOptions{.extents = extents,
                           .bits = format.bits,
                           .folder = std::filesystem::absolute(config_.state_folder),
                           .leave_free_bytes = static_cast<std::uint64_t>(config_.store.free_mb) * 1'000'000 / 2,
                           .ignored_part = Station::kTestPart,
                           .check_folder = [this] { return state_lock_.check_place(); },
                           .report = write_report,
                           .trouble = [this](const Error& error) { on_trouble(error); }});
    }

    RecordingWatchers recording;
    recording.trouble = [this](const Error& error) { on_trouble(error); };
    recording.faults = [this](std::uint32_t faults) {
        store_faults_ = faults;
        report_faults();
    };
    recorder_ = make_recorder(
        *loop_, config_,
        {HORD_VERSION, identity_.boot_id, extents, format.bits, recipe.recipe.name, recorded_recipe(recipe)},
        recording);
    return {};
}

void Service::connect(NumberedRecipe recipe, const algo::Extents& extents) {
    CommandHandler::Dependencies dependencies{.station = *station_,
                                              .inspector = *inspector_,
                                              .plc_interface = *plc_interface_,
                                              .extents = extents,
                                              .recorder = recorder_.get()};
    dependencies.teacher = teach_in_.get();
    dependencies.check_judgement = [this, bits = backends_->sensor().format().bits] {
        return check_judgement(config_.inspection.bins_i, config_.inspection.bins_j, bits);
    };
    dependencies.recipe = [this](std::uint16_t number) -> Result<NumberedRecipe> {
        if (config_.inspection.recipes.empty())
            return fail(ErrorCode::not_found, "there is no folder of recipes", "name one in inspection.recipes");
        return find_recipe(config_.inspection.recipes, number);
    };
    dependencies.recipe_changed = [this](const NumberedRecipe& now) {
        on_recipe(now);
        if (watchers_.recipe) watchers_.recipe(now);
    };
    dependencies.keep = [this](const NumberedRecipe& now) {
        auto kept = keep_recipe(now);
        if (kept && std::exchange(recipe_fault_, 0U) != 0) loop_->post([this] { report_faults(); });
        return kept;
    };
    dependencies.publish = [this] { publish(); };
    dependencies.trouble = [this](const Error& error) { on_trouble(error); };
    on_recipe(recipe);
    // A recipe that is lost stays so until another is chosen: a further restart tells it, too.
    if (recipe_fault_ != 0) loop_->post([this] { report_faults(); });
    else if (const auto kept = keep_recipe(recipe); !kept) on_trouble(kept.error());
    command_handler_->begin(std::move(dependencies), std::move(recipe));
}

Result<void> Service::lock_folders() {
    if (!config_.state_folder.empty()) {
        if (auto done = assign(state_lock_, StateLock::take(config_.state_folder)); !done) return done;
    }
    return assign(store_lock_, lock_store(config_));
}

Result<void> Service::open_all(const SimulationOptions& simulation) {
    if (auto done = lock_folders(); !done) return done;
    if (auto done = assign(loop_, SdEventLoop::open()); !done) return done;
    opened_at_ = loop_->now();
    identity_ = identity_of(config_, simulation);
    // A message that nobody reads, or a signal sent by mistake, must not end a station: its line would run on.
    for (const int signal : {SIGPIPE, SIGUSR1, SIGUSR2, SIGALRM}) std::signal(signal, SIG_IGN);
    if (auto done = loop_->stop_on_signals(kEndSignals); !done) return done;
    const bool hangup_stops = !watchers_.reload && !is_ignored(SIGHUP);  // its terminal was closed; nohup ignores that
    if (hangup_stops) {
        if (auto done = loop_->stop_on_signals({SIGHUP}); !done) return done;
    } else if (watchers_.reload) {
        if (auto done = loop_->on_signal(SIGHUP, [this] { watchers_.reload(); }); !done) return done;
    }
    // The ports come before the devices: a quick check. Own ones stay closed until somebody answers. Those of systemd
    // are open all the time: their clients wait.
    prepare_registers();
    if (sockets_.modbus < 0 && sockets_.modbus_read_only < 0) {
        if (auto done = open_servers(); !done) return done;
        close_servers();
    }

    SimulationOptions watched = simulation;
    watched.progress = [this, hangup_stops, show = simulation.progress](double done) {
        if (stop_waits(hangup_stops)) {
            if (watchers_.stopped_early) watchers_.stopped_early();
            std::_Exit(0);  // nothing runs yet
        }
        if (show) show(done);
    };
    if (auto done = assign(backends_, Backends::open(*loop_, config_, watched)); !done) return done;
    backends_->watch_line(watchers_.fate, [this, all = simulation.parts == 0] {
        if (all && std::holds_alternative<FrameFolder>(config_.sensor)) {
            on_trouble({ErrorCode::disconnected, "the last recorded frame was played: no part comes any more",
                        "restart to play the frames again"});
        }
        if (watchers_.line_over) watchers_.line_over();
    });

    const hal::SensorFormat format = backends_->sensor().format();
    const auto extents = open_grid(format);
    if (!extents) return tl::unexpected(extents.error());
    if (!config_.state_folder.empty()) {
        if (auto here = state_lock_.check_place(); !here) return here;
    }
    NumberedRecipe recipe = first_recipe(*extents, format.bits);
    if (auto done = open_inspector(recipe, *extents); !done) return done;
    station_ = std::make_unique<Station>(config_.core,
                                         Cell{*loop_, backends_->part_sensor(), backends_->strobe(),
                                              backends_->sensor(), backends_->rejector(), *inspector_},
                                         this);
    connect(std::move(recipe), *extents);
    if (auto done = open_servers(); !done) return done;
    publish_again();
    publish_health_again();
    return {};
}

Result<std::unique_ptr<Service>> Service::open(const Config& config, StationFiles files,
                                               const SimulationOptions& simulation, ServiceWatchers watchers,
                                               const ListenSockets& sockets) {
    std::unique_ptr<Service> service(new Service(config, std::move(files), std::move(watchers), sockets));
    if (auto done = service->open_all(simulation); !done) return tl::unexpected(done.error());
    return service;
}

// Withdraws the proof that the process before left, and returns whether it said that the line is empty.
bool Service::withdraw_proof() {
    const auto proven = state_lock_.check_place().and_then([&] { return empty_line_.withdraw(); });
    proof_withdrawn_ = proven.has_value();
    if (!proven) on_trouble(proven.error());
    return proven.value_or(false);
}

// Stops the belt and proves that the line is empty, if it is and the part sensor has watched it. Parts that come while
// the belt stops are still seen.
void Service::prove_empty_line() {
    const std::uint32_t seen = station_->snapshot().counters.seen;
    const auto uncertain = [&] {
        const Snapshot now = station_->snapshot();
        const bool watched = now.state != State::preoperational && now.state != State::halted &&
            (now.faults_active & kFaultPartSensor) == 0;
        return !watched || now.line_stop || now.parts_on_line > 0 || now.counters.seen != seen;
    };
    if (uncertain()) return;
    station_->request(Command::abort);  // drops the run permit; refused where there is none
    // A further signal ends the loop, and not this watch: a proof too early would be false.
    for (const auto until = loop_->now() + kBeltStops; loop_->now() < until;) {
        if (loop_->run_until(uncertain, until - loop_->now())) return;
    }
    const auto given = state_lock_.check_place().and_then([&] { return empty_line_.give(); });
    if (!given) on_trouble(given.error());
}

Result<void> Service::run() {
    loop_->call_after(kLineWaits, [this] { backends_->start_line(); });
    empty_line_ = EmptyLineProof(config_.state_folder);
    // A simulated line begins with this process, and is empty.
    if (!withdraw_proof() && !std::holds_alternative<SimulatedPartSensor>(config_.part_sensor)) {
        on_trouble({ErrorCode::not_found, "it is not known what is on the line: nothing proves that it was empty",
                    "take every part off the line, then reset"});
        station_->line_unknown();
    }
    if (config_.autostart) station_->run();
    else station_->request(Command::initialise);
    auto done = loop_->run();
    prove_empty_line();
    return done;
}

// In the order of the destructor. The store comes last: the line must not wait for it.
std::vector<Error> Service::close() {
    if (station_) halt();
    close_servers();
    registers_.reset();
    plc_interface_.reset();
    command_handler_.reset();
    station_.reset();
    inspector_.reset();
    backends_.reset();
    return recorder_ ? recorder_->finish() : std::vector<Error>();
}

std::string Service::registers_address() const { return server_->address(); }

}  // namespace hord::firmware
