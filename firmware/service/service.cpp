#include "firmware/service/service.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <optional>
#include <random>
#include <vector>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/devices/active_calibration.h"
#include "firmware/diagnostics/inspection_self_test.h"
#include "firmware/modbus/rtu_server.h"
#include "firmware/modbus/tcp_server.h"
#include "firmware/monitoring/drift_monitor.h"
#include "firmware/monitoring/optics_report.h"
#include "firmware/plc/command_handler.h"
#include "firmware/plc/register_server_model.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/recipes/teach_in.h"
#include "firmware/station/line_occupancy_marker.h"
#include "firmware/store/recorder/store_setup.h"

namespace hord::firmware {
namespace {

// The registers follow every result and change of state at once, and the rest (heartbeats, parts on the line) at this
// pace.
constexpr Duration kPublishEvery = milliseconds(50);
constexpr Duration kHealthEvery = milliseconds(1000);
constexpr const char* kRecipeInUse = "recipe-in-use.toml";
constexpr const char* kCalibrationInUse = "calibration-in-use.toml";
constexpr const char* kProcessorMillidegrees = "/sys/class/thermal/thermal_zone0/temp";

StationIdentity identity_of(const Config& config) {
    StationIdentity identity;
    identity.firmware = HORD_VERSION;
    identity.serial = config.name;
    // A command's `boot` is the low half, where 0 means any boot.
    while ((identity.boot_id & 0xFFFFU) == 0) identity.boot_id = std::random_device{}();
    return identity;
}

std::optional<double> processor_celsius() {
    std::ifstream in(kProcessorMillidegrees);
    double millidegrees = 0;
    return in >> millidegrees ? std::optional(millidegrees / 1000) : std::nullopt;
}

std::optional<double> disk_free_percent(const std::filesystem::path& folder) {
    if (folder.empty()) return std::nullopt;
    std::error_code error;
    const auto space = std::filesystem::space(folder, error);
    if (error || space.capacity == 0) return std::nullopt;
    return 100.0 * static_cast<double>(space.available) / static_cast<double>(space.capacity);
}

}  // namespace

// Members are destroyed in reverse order: the station halts before its devices go, the devices before the loop; who
// asks over the network goes first.
struct Service::Components final : StationObserver, InspectionObserver {
    Config config;
    ListenSockets doors;
    ServiceWatchers watchers;
    std::unique_ptr<SdEventLoop> loop;
    std::unique_ptr<store::StationRecorder> recorder;
    std::unique_ptr<Backends> backends;
    std::unique_ptr<DriftMonitor> drift;    // fed by the inspector's threads
    std::unique_ptr<OpticsMonitor> optics;  // the same
    std::unique_ptr<LineTeachIn> teacher;   // fed by them, too; none: there is no state folder
    CalibrationReport calibration;
    std::optional<ActiveCalibration> grid;  // none: frames are macro-pixels
    std::uint32_t store_faults = 0, drift_fault = 0, optics_faults = 0;
    std::unique_ptr<Inspector> inspector;
    std::unique_ptr<Station> station;
    std::optional<CommandHandler> operations;
    std::optional<PlcInterface> desk;
    std::optional<RegisterServerModel> registers;
    std::unique_ptr<modbus::Server> server, read_only_server;
    std::unique_ptr<modbus::RtuServer> serial_server;

    OccupancyMarker line_mark{{}};
    std::vector<PartResult> unpublished;
    HealthReport health;
    hal::TimePoint opened_at{};
    std::uint32_t configured_recipe = 0;  // CRC-32
    std::uint32_t boot_id = 0;

    // Every result once, in order: several may be complete between two calls.
    void publish() {
        registers->publish(station->snapshot(), unpublished);
        unpublished.clear();
    }
    void publish_again() {
        desk->check_heartbeat();
        publish();
        (void)operations->use_learned_reference();
        loop->call_after(kPublishEvery, [this] { publish_again(); });
    }
    void publish_health_again();

    void on_result(const PartResult& result) override {
        if (recorder) recorder->on_result(result);
        const auto lost = static_cast<std::uint32_t>(result.reason == PartReason::frame_lost);
        const auto corrupt = static_cast<std::uint32_t>(result.reason >= PartReason::frame_stale &&
                                                        result.reason <= PartReason::frame_corrupt);
        health.frames_lost = health.frames_lost.value_or(0) + lost;
        health.frames_corrupt = health.frames_corrupt.value_or(0) + corrupt;
        unpublished.push_back(result);
        loop->post([this] { publish(); });  // the core has finished its step by then
        if (watchers.result) watchers.result(result);
    }
    void on_state(State from, State to) override {
        loop->post([this] {
            publish();
            (void)operations->use_learned_reference();
        });
        if (to == State::continuous_execution || to == State::single_execution) {
            if (!line_mark.left_behind()) line_mark.raise();
            backends->start_line();
            backends->feed_line(true);
        } else if (executing(from)) {
            backends->feed_line(false);
        }
        if (watchers.state) watchers.state(from, to);
    }
    void on_trouble(const Error& error) override {
        if (watchers.trouble) watchers.trouble(error);
    }
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) override {
        if (recorder) recorder->on_inspection(part, frame, inspection);
        if (teacher) teacher->on_inspection(part, frame, inspection);
        if (watchers.inspection) watchers.inspection(part, frame, inspection);
        if (drift && drift->add(frame)) loop->post([this] { on_drift(); });
        if (optics && part != Station::kTestPart && optics->add(frame, inspection)) loop->post([this] { on_optics(); });
    }
    // Noticed, or gone again.
    void on_drift() {
        const DriftMonitor::View view = drift->view();
        if (view.noticed && watchers.trouble) {
            watchers.trouble({ErrorCode::invalid_argument,
                              fmt::format("the lenslet grid has moved by {:.2f} px since {}", *view.largest_px,
                                          view.since_calibration ? "the calibration" : "the first parts"),
                              "let the optics settle in temperature, check that the sensor is fastened; if it stays, "
                              "calibrate (hordctl calibrate) and restart"});
        }
        drift_fault = view.noticed ? std::uint32_t{kFaultGridDrift} : 0U;
        publish_calibration();
        tell_faults();
    }
    // Something of light or optics became a fault, or is none any more; or dust lies somewhere else.
    void on_optics() {
        const OpticsMonitor::View view = optics->view();
        const std::uint32_t news = optics->news();
        for (const FaultText& fault : fault_texts()) {
            if ((news & fault.bit) != 0 && watchers.trouble) watchers.trouble(describe(fault.bit, view));
        }
        optics_faults = view.faults;
        health.optics = report_of(view);
        registers->publish(health);
        tell_faults();
    }
    void tell_faults() {
        station->outside_faults(store_faults | drift_fault | optics_faults);
        publish();
    }
    void publish_calibration() {
        calibration.drift_px = drift->view().largest_px;
        if (grid) calibration.age_s = grid->age_s();
        registers->publish(calibration);
    }
    void on_recipe(const NumberedRecipe& recipe) {
        registers->publish(RecipeInUse{recipe.number, crc32_of(recipe), ShortText(recipe.recipe.name)});
        optics->restart(
            recipe.recipe.lenslet_mm);  // what parts showed under another recipe says nothing of them under this one
        if (optics_faults != 0) loop->post([this] { on_optics(); });
    }

    Result<void> open(const SimulationOptions& simulation);
    Result<void> open_doors();
    Result<NumberedRecipe> first_recipe();
    Result<algo::Extents> open_grid(const hal::SensorFormat& format);
    Result<void> open_inspector(const NumberedRecipe& recipe);
    void connect(NumberedRecipe recipe);
    Result<std::vector<std::string>> reload(const Config& next);
};

// The ports: the cheapest thing that can be wrong. Nobody is answered before the loop runs.
Result<void> Service::Components::open_doors() {
    const StationIdentity identity = identity_of(config);
    boot_id = identity.boot_id;
    operations.emplace(*loop);
    desk.emplace(*loop, *operations, PlcOptions{config.core.plc_policy, config.plc.timeout, identity.boot_id});
    registers.emplace(identity, &*desk);
    modbus::ServerOptions options;
    options.host = config.modbus.host;
    options.port = config.modbus.port;
    options.max_connections = config.modbus.max_connections;
    options.access = config.modbus.access;
    auto listening = doors.modbus >= 0 ? modbus::Server::adopt(*loop, *registers, doors.modbus, options)
                                       : modbus::Server::open(*loop, *registers, options);
    if (!listening) return tl::unexpected(listening.error());
    server = std::move(*listening);
    if (config.modbus.read_only_port != 0 || doors.modbus_read_only >= 0) {
        options.port = config.modbus.read_only_port;
        options.may_write = false;
        auto reading = doors.modbus_read_only >= 0
            ? modbus::Server::adopt(*loop, *registers, doors.modbus_read_only, options)
            : modbus::Server::open(*loop, *registers, options);
        if (!reading) return tl::unexpected(reading.error());
        read_only_server = std::move(*reading);
    }
    if (config.serial) {
        auto line = modbus::RtuServer::open(*loop, *registers, *config.serial);
        if (!line) return tl::unexpected(line.error());
        serial_server = std::move(*line);
    }
    return {};
}

// The configured one, or what was committed since it was configured.
Result<NumberedRecipe> Service::Components::first_recipe() {
    NumberedRecipe recipe;
    if (!config.inspection.recipe.empty()) {
        auto loaded = load_numbered_recipe(config.inspection.recipe);
        if (!loaded) return loaded;
        recipe = std::move(*loaded);
    }
    configured_recipe = crc32_of(recipe);
    if (!config.state_folder.empty()) {
        const auto take = [&](Result<std::optional<NumberedRecipe>> kept) {
            if (kept && *kept) recipe = std::move(**kept);
            if (!kept) {
                on_trouble({kept.error().code,
                            fmt::format("what was in use before the restart cannot be used again, recipe {} is: {}",
                                        recipe.number, kept.error().what),
                            kept.error().cure});
            }
        };
        take(remembered_recipe(config.state_folder / kRecipeInUse, configured_recipe));
        take(LineTeachIn::pending_recipe(config.state_folder, recipe));
    }
    return recipe;
}

// The light field's size: that of macro-pixel frames, or what the calibration makes of raw ones.
Result<algo::Extents> Service::Components::open_grid(const hal::SensorFormat& format) {
    const InspectionConfig& wanted = config.inspection;
    if (wanted.grid.empty())
        return algo::extents_of_frame(format.width_px, format.height_px, wanted.bins_i, wanted.bins_j);
    const auto kept = config.state_folder.empty() ? std::filesystem::path() : config.state_folder / kCalibrationInUse;
    auto used = use_calibration(wanted.grid, kept, format, wanted.bins_i, wanted.bins_j);
    if (!used) return tl::unexpected(used.error());
    grid = std::move(*used);
    const calib::GridStatistics& s = grid->file.statistics;
    calibration.id = grid->crc32;
    calibration.residual_px = std::sqrt(0.5 * (s.rms_x_px * s.rms_x_px + s.rms_y_px * s.rms_y_px));
    return grid->decoder->extents();
}

Result<void> Service::Components::open_inspector(const NumberedRecipe& recipe) {
    const hal::SensorFormat format = backends->sensor().format();
    auto extents = open_grid(format);
    if (!extents) return tl::unexpected(extents.error());
    InspectorSettings settings;
    settings.extents = *extents;
    if (grid) settings.decoder = grid->decoder;
    settings.bits = format.bits;
    settings.threads = config.inspection.threads;
    settings.queue = config.inspection.queue;
    settings.recipe = recipe.recipe;
    settings.recipe_number = recipe.number;
    settings.observer = this;
    auto made = make_threaded_inspector(*loop, settings);
    if (!made) return tl::unexpected(made.error());
    inspector = std::move(*made);
    auto watch = DriftMonitor::create(*extents, algo::light_levels(recipe.recipe, format.bits),
                                      grid ? algo::DriftZero::calibration : algo::DriftZero::first_parts,
                                      grid ? grid->decoder->bin_px() : 1);
    if (!watch) return tl::unexpected(watch.error());
    drift = std::move(*watch);
    auto watched = OpticsMonitor::create(*extents, limits_of(config.optics, format.bits));
    if (!watched) return tl::unexpected(watched.error());
    optics = std::move(*watched);
    calibration.lenslets_m = static_cast<std::uint16_t>(extents->m);
    calibration.lenslets_n = static_cast<std::uint16_t>(extents->n);
    publish_calibration();
    if (!config.state_folder.empty()) {
        TeachInOptions teaching;
        teaching.extents = *extents;
        teaching.bits = format.bits;
        teaching.folder = std::filesystem::absolute(config.state_folder);
        teaching.leave_free_bytes = static_cast<std::uint64_t>(config.store.free_mb) * 1'000'000 / 2;
        teaching.ignored_part = Station::kTestPart;
        teacher = std::make_unique<LineTeachIn>(*loop, std::move(teaching));
    }

    RecordingWatchers recording;
    recording.trouble = [this](const Error& error) { on_trouble(error); };
    recording.faults = [this](std::uint32_t faults) {
        store_faults = faults;
        tell_faults();
    };
    recorder = make_recorder(*loop, config,
                             {HORD_VERSION, boot_id, *extents, format.bits, recipe.recipe.name, format_recipe(recipe)},
                             recording);
    return {};
}

void Service::Components::connect(NumberedRecipe recipe) {
    CommandHandler::Dependencies works{
        .station = *station, .inspector = *inspector, .desk = *desk, .recorder = recorder.get()};
    works.teacher = teacher.get();
    works.check_judgement = [this, bits = backends->sensor().format().bits] {
        return check_judgement(config.inspection.bins_i, config.inspection.bins_j, bits);
    };
    works.recipe = [this](std::uint16_t number) -> Result<NumberedRecipe> {
        if (config.inspection.recipes.empty())
            return fail(ErrorCode::not_found, "there is no folder of recipes", "name one in inspection.recipes");
        return find_recipe(config.inspection.recipes, number);
    };
    works.recipe_changed = [this](const NumberedRecipe& now) {
        on_recipe(now);
        if (watchers.recipe) watchers.recipe(now);
        if (config.state_folder.empty()) return;
        if (auto kept = remember_recipe(config.state_folder / kRecipeInUse, configured_recipe, now); !kept)
            return on_trouble(kept.error());
        teacher->in_use(now);
    };
    works.publish = [this] { publish(); };
    works.trouble = [this](const Error& error) { on_trouble(error); };
    on_recipe(recipe);
    operations->begin(std::move(works), std::move(recipe));
}

Result<void> Service::Components::open(const SimulationOptions& simulation) {
    auto opened = SdEventLoop::open();
    if (!opened) return tl::unexpected(opened.error());
    loop = std::move(*opened);
    opened_at = loop->now();
    if (auto done = loop->stop_on_signals(); !done) return done;
    if (watchers.reload) {
        if (auto done = loop->on_signal(SIGHUP, [this] { watchers.reload(); }); !done) return done;
    }
    if (auto done = open_doors(); !done) return done;

    auto devices = Backends::open(*loop, config, simulation);
    if (!devices) return tl::unexpected(devices.error());
    backends = std::move(*devices);
    backends->watch_line(watchers.fate, watchers.line_over);

    auto recipe = first_recipe();
    if (!recipe) return tl::unexpected(recipe.error());
    if (auto done = open_inspector(*recipe); !done) return done;
    station = std::make_unique<Station>(
        config.core,
        Cell{*loop, backends->part_sensor(), backends->strobe(), backends->sensor(), backends->rejector(), *inspector},
        this);
    connect(std::move(*recipe));
    publish_again();
    publish_health_again();
    return {};
}

void Service::Components::publish_health_again() {
    health.uptime_s =
        static_cast<std::uint32_t>(std::chrono::duration_cast<std::chrono::seconds>(loop->now() - opened_at).count());
    health.frames_lost = health.frames_lost.value_or(0);
    health.frames_corrupt = health.frames_corrupt.value_or(0);
    health.frames_waiting = static_cast<std::uint16_t>(inspector->waiting());
    modbus::ServerStatistics all = server->statistics();
    if (read_only_server) {
        const modbus::ServerStatistics more = read_only_server->statistics();
        all.connections += more.connections;
        all.requests += more.requests;
        all.exceptions += more.exceptions;
        all.evicted += more.evicted;
        all.broken += more.broken;
    }
    const auto counted = [](std::uint64_t n) {
        return static_cast<std::uint32_t>(std::min<std::uint64_t>(n, 0xFFFFFFFE));
    };
    health.modbus_connections = counted(all.connections);
    health.modbus_requests = counted(all.requests);
    health.modbus_exceptions = counted(all.exceptions);
    health.modbus_evicted = counted(all.evicted);
    health.modbus_broken = counted(all.broken);
    health.processor_celsius = processor_celsius();
    health.disk_free_percent = disk_free_percent(config.state_folder);
    health.optics = report_of(optics->view());
    registers->publish(health);
    publish_calibration();
    loop->call_after(kHealthEvery, [this] { publish_health_again(); });
}

// -- reload

namespace {

bool same_doors(const TcpServer& a, const TcpServer& b) {
    return a.host == b.host && a.port == b.port && a.read_only_port == b.read_only_port &&
        a.max_connections == b.max_connections;
}

}  // namespace

Result<std::vector<std::string>> Service::Components::reload(const Config& next) {
    // The recipe first: it alone can be refused.
    std::vector<std::string> waiting;
    NumberedRecipe recipe;
    if (!next.inspection.recipe.empty()) {
        auto loaded = load_numbered_recipe(next.inspection.recipe);
        if (!loaded) return tl::unexpected(loaded.error());
        recipe = std::move(*loaded);
    }
    if (const std::uint32_t crc = crc32_of(recipe); crc != configured_recipe) {
        if (executing(station->core().state())) {
            waiting.emplace_back("inspection.recipe (stop the station, then reload again)");
        } else {
            const std::uint32_t before = std::exchange(configured_recipe, crc);
            if (auto used = operations->use({}, std::move(recipe)); !used) {
                configured_recipe = before;
                return tl::unexpected(used.error());
            }
        }
    }
    server->set_access(next.modbus.access);
    if (read_only_server) read_only_server->set_access(next.modbus.access);
    desk->set_timeout(next.plc.timeout);
    config.inspection.recipes = next.inspection.recipes;
    config.inspection.recipe = next.inspection.recipe;
    config.modbus.access = next.modbus.access;
    config.plc = next.plc;

    const auto restart = [&](bool differs, const char* table) {
        if (differs) waiting.emplace_back(table);
    };
    CoreConfig other = next.core;
    other.plc_policy = config.core.plc_policy;
    restart(next.name != config.name || next.autostart != config.autostart, "[station]");
    restart(other != config.core, "[line], [timing] or [rejector]'s times");
    restart(next.core.plc_policy != config.core.plc_policy, "plc.policy");
    restart(next.sensor != config.sensor, "[sensor]");
    restart(next.strobe != config.strobe, "[strobe]");
    restart(next.part_sensor != config.part_sensor, "[part_sensor]");
    restart(next.rejector != config.rejector, "[rejector]");
    restart(!same_doors(next.modbus, config.modbus), "[modbus] addresses, ports or connections");
    restart(next.serial != config.serial, "[serial]");
    restart(next.inspection.bins_i != config.inspection.bins_i || next.inspection.bins_j != config.inspection.bins_j ||
                next.inspection.threads != config.inspection.threads ||
                next.inspection.queue != config.inspection.queue,
            "[inspection] macro, threads or queue");
    restart(next.inspection.grid != config.inspection.grid, "inspection.grid");
    restart(next.optics != config.optics, "[optics]");
    restart(next.store != config.store, "[store]");
    if (recorder) note_configuration(*recorder, next);
    return waiting;
}

Service::Service(std::unique_ptr<Components> parts) : parts_(std::move(parts)) {}
Service::~Service() = default;

Result<std::unique_ptr<Service>> Service::open(const Config& config, const SimulationOptions& simulation,
                                               ServiceWatchers watchers, const ListenSockets& doors) {
    auto parts = std::make_unique<Components>();
    parts->config = config;
    parts->doors = doors;
    parts->watchers = std::move(watchers);
    if (auto done = parts->open(simulation); !done) return tl::unexpected(done.error());
    return std::unique_ptr<Service>(new Service(std::move(parts)));
}

Result<void> Service::run() {
    parts_->loop->call_after(kLineWaits, [this] { parts_->backends->start_line(); });
    parts_->line_mark = OccupancyMarker(parts_->config.state_folder);
    if (parts_->line_mark.left_behind()) parts_->station->line_unknown();
    if (parts_->config.autostart) {
        parts_->station->run();
    } else {
        parts_->station->request(Command::initialise);
    }
    auto done = parts_->loop->run();
    const Core& core = parts_->station->core();
    if (core.line().size() == 0 && !core.line_stop()) parts_->line_mark.clear();
    return done;
}

void Service::stop() { parts_->loop->request_stop(); }
Result<std::vector<std::string>> Service::reload(const Config& config) { return parts_->reload(config); }
void Service::look_after_line() {
    parts_->backends->clear_line();
    parts_->station->request(Command::reset);
}
void Service::liveness_check(std::function<void()> all_here) { parts_->inspector->liveness_check(std::move(all_here)); }
SdEventLoop& Service::loop() { return *parts_->loop; }
Backends& Service::backends() { return *parts_->backends; }
Snapshot Service::snapshot() const { return parts_->station->snapshot(); }
std::string Service::registers_address() const {
    return fmt::format("{}:{}", parts_->config.modbus.host, parts_->server->port());
}

}  // namespace hord::firmware
