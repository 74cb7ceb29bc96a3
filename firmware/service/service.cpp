// Opens a service and runs it. The events of a running one: service_events.cpp; reload: service_reload.cpp.
#include "firmware/service/service.h"

#include <cmath>
#include <csignal>
#include <filesystem>
#include <optional>
#include <random>
#include <vector>

#include <fmt/format.h>

#include "firmware/diagnostics/inspection_self_test.h"
#include "firmware/monitoring/optics_report.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/service/service_components.h"

namespace hord::firmware {
namespace {

constexpr const char* kRecipeInUse = "recipe-in-use.toml";
constexpr const char* kCalibrationInUse = "calibration-in-use.toml";

StationIdentity identity_of(const Config& config) {
    StationIdentity identity;
    identity.firmware = HORD_VERSION;
    identity.serial = config.name;
    // The low half must not be 0: in a command's `boot` that means any boot.
    while ((identity.boot_id & 0xFFFFU) == 0) identity.boot_id = std::random_device{}();
    return identity;
}

}  // namespace

// The ports come first: the quickest check. Requests are answered only when the loop runs.
Result<void> Service::Components::open_servers() {
    const StationIdentity identity = identity_of(config);
    boot_id = identity.boot_id;
    command_handler.emplace(*loop);
    plc_interface.emplace(*loop, *command_handler,
                          PlcOptions{config.core.plc_policy, config.plc.timeout, identity.boot_id});
    registers.emplace(identity, &*plc_interface);
    modbus::ServerOptions options;
    options.host = config.modbus.host;
    options.port = config.modbus.port;
    options.max_connections = config.modbus.max_connections;
    options.access = config.modbus.access;
    auto listening = sockets.modbus >= 0 ? modbus::Server::adopt(*loop, *registers, sockets.modbus, options)
                                         : modbus::Server::open(*loop, *registers, options);
    if (!listening) return tl::unexpected(listening.error());
    server = std::move(*listening);
    if (config.modbus.read_only_port != 0 || sockets.modbus_read_only >= 0) {
        options.port = config.modbus.read_only_port;
        options.may_write = false;
        auto reading = sockets.modbus_read_only >= 0
            ? modbus::Server::adopt(*loop, *registers, sockets.modbus_read_only, options)
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

// The configured recipe, or the one that has replaced it since by commands.
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

// Size of the light field: from the format of macro-pixel frames, or from the calibration for raw ones.
Result<algo::Extents> Service::Components::open_grid(const hal::SensorFormat& format) {
    const InspectionConfig& inspection = config.inspection;
    if (inspection.grid.empty())
        return algo::extents_of_frame(format.width_px, format.height_px, inspection.bins_i, inspection.bins_j);
    const auto kept = config.state_folder.empty() ? std::filesystem::path() : config.state_folder / kCalibrationInUse;
    auto used = use_calibration(inspection.grid, kept, format, inspection.bins_i, inspection.bins_j);
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
    auto drift_monitor = DriftMonitor::create(*extents, algo::light_levels(recipe.recipe, format.bits),
                                              grid ? algo::DriftZero::calibration : algo::DriftZero::first_parts,
                                              grid ? grid->decoder->bin_px() : 1);
    if (!drift_monitor) return tl::unexpected(drift_monitor.error());
    drift = std::move(*drift_monitor);
    auto optics_monitor = OpticsMonitor::create(*extents, limits_of(config.optics, format.bits));
    if (!optics_monitor) return tl::unexpected(optics_monitor.error());
    optics = std::move(*optics_monitor);
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
        teach_in = std::make_unique<LineTeachIn>(*loop, std::move(teaching));
    }

    RecordingWatchers recording;
    recording.trouble = [this](const Error& error) { on_trouble(error); };
    recording.faults = [this](std::uint32_t faults) {
        store_faults = faults;
        report_faults();
    };
    recorder = make_recorder(*loop, config,
                             {HORD_VERSION, boot_id, *extents, format.bits, recipe.recipe.name, format_recipe(recipe)},
                             recording);
    return {};
}

void Service::Components::connect(NumberedRecipe recipe) {
    CommandHandler::Dependencies dependencies{
        .station = *station, .inspector = *inspector, .plc_interface = *plc_interface, .recorder = recorder.get()};
    dependencies.teacher = teach_in.get();
    dependencies.check_judgement = [this, bits = backends->sensor().format().bits] {
        return check_judgement(config.inspection.bins_i, config.inspection.bins_j, bits);
    };
    dependencies.recipe = [this](std::uint16_t number) -> Result<NumberedRecipe> {
        if (config.inspection.recipes.empty())
            return fail(ErrorCode::not_found, "there is no folder of recipes", "name one in inspection.recipes");
        return find_recipe(config.inspection.recipes, number);
    };
    dependencies.recipe_changed = [this](const NumberedRecipe& now) {
        on_recipe(now);
        if (watchers.recipe) watchers.recipe(now);
        if (config.state_folder.empty()) return;
        if (auto kept = remember_recipe(config.state_folder / kRecipeInUse, configured_recipe, now); !kept)
            return on_trouble(kept.error());
        teach_in->in_use(now);
    };
    dependencies.publish = [this] { publish(); };
    dependencies.trouble = [this](const Error& error) { on_trouble(error); };
    on_recipe(recipe);
    command_handler->begin(std::move(dependencies), std::move(recipe));
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
    if (auto done = open_servers(); !done) return done;

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

Service::Service(std::unique_ptr<Components> components) : components_(std::move(components)) {}
Service::~Service() = default;

Result<std::unique_ptr<Service>> Service::open(const Config& config, const SimulationOptions& simulation,
                                               ServiceWatchers watchers, const ListenSockets& sockets) {
    auto components = std::make_unique<Components>();
    components->config = config;
    components->sockets = sockets;
    components->watchers = std::move(watchers);
    if (auto done = components->open(simulation); !done) return tl::unexpected(done.error());
    return std::unique_ptr<Service>(new Service(std::move(components)));
}

Result<void> Service::run() {
    components_->loop->call_after(kLineWaits, [this] { components_->backends->start_line(); });
    components_->occupancy_marker = OccupancyMarker(components_->config.state_folder);
    if (components_->occupancy_marker.left_behind()) components_->station->line_unknown();
    if (components_->config.autostart) {
        components_->station->run();
    } else {
        components_->station->request(Command::initialise);
    }
    auto done = components_->loop->run();
    const Core& core = components_->station->core();
    if (core.line().size() == 0 && !core.line_stop()) components_->occupancy_marker.clear();
    return done;
}

void Service::stop() { components_->loop->request_stop(); }
Result<std::vector<std::string>> Service::reload(const Config& config) { return components_->reload(config); }
void Service::look_after_line() {
    components_->backends->clear_line();
    components_->station->request(Command::reset);
}
void Service::liveness_check(std::function<void()> all_here) {
    components_->inspector->liveness_check(std::move(all_here));
}
SdEventLoop& Service::loop() { return *components_->loop; }
Backends& Service::backends() { return *components_->backends; }
Snapshot Service::snapshot() const { return components_->station->snapshot(); }
std::string Service::registers_address() const {
    return fmt::format("{}:{}", components_->config.modbus.host, components_->server->port());
}

}  // namespace hord::firmware
