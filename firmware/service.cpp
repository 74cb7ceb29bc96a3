#include "firmware/service.h"

#include <optional>
#include <random>
#include <vector>

#include <fmt/format.h>

#include "firmware/modbus/server.h"
#include "firmware/recipe_file.h"
#include "firmware/registers_image.h"

namespace hord::firmware {
namespace {

// The registers follow every result and change of state at once, and the rest (heartbeat, parts on the line) at this pace.
constexpr Duration kPublishEvery = milliseconds(50);

StationIdentity identity_of(const Config& config) {
    StationIdentity identity;
    identity.firmware = HORD_VERSION;
    identity.serial = config.name;
    identity.boot_id = std::random_device{}();
    return identity;
}

}  // namespace

// Members are destroyed in reverse order: the station halts before its devices go, the devices before the loop.
struct Service::Parts final : StationObserver, InspectionObserver {
    ServiceWatchers watchers;
    std::unique_ptr<SdEventLoop> loop;
    std::unique_ptr<Backends> backends;
    std::unique_ptr<Inspector> inspector;
    std::optional<RegisterImage> registers;
    std::unique_ptr<modbus::Server> server;
    std::unique_ptr<Station> station;
    std::string host;

    std::vector<PartResult> unpublished;

    // Every result once, in order: several may be complete between two calls.
    void publish() {
        registers->publish(station->snapshot(), unpublished);
        unpublished.clear();
    }
    void publish_again() {
        publish();
        loop->call_after(kPublishEvery, [this] { publish_again(); });
    }

    void on_result(const PartResult& result) override {
        unpublished.push_back(result);
        loop->post([this] { publish(); });  // the core has finished its step by then
        if (watchers.result) watchers.result(result);
    }
    void on_state(State from, State to) override {
        loop->post([this] { publish(); });
        if (to == State::continuous_execution) backends->start_line();
        if (watchers.state) watchers.state(from, to);
    }
    void on_trouble(const Error& error) override {
        if (watchers.trouble) watchers.trouble(error);
    }
    void on_inspection(std::uint32_t part, const algo::FrameView& frame, const algo::Inspection& inspection) override {
        if (watchers.inspection) watchers.inspection(part, frame, inspection);
    }

    Result<void> open(const Config& config, const SimulationOptions& simulation);
};

Result<void> Service::Parts::open(const Config& config, const SimulationOptions& simulation) {
    auto opened = SdEventLoop::open();
    if (!opened) return tl::unexpected(opened.error());
    loop = std::move(*opened);
    if (auto done = loop->stop_on_signals(); !done) return done;

    // The port first: it is the cheapest thing that can be wrong.
    host = config.modbus.host;
    registers.emplace(identity_of(config));
    auto listening = modbus::Server::open(*loop, *registers, {.host = host, .port = config.modbus.port, .may_write = false});
    if (!listening) return tl::unexpected(listening.error());
    server = std::move(*listening);

    auto devices = Backends::open(*loop, config, simulation);
    if (!devices) return tl::unexpected(devices.error());
    backends = std::move(*devices);
    if (watchers.fate) backends->watch_fates(watchers.fate);

    const hal::SensorFormat format = backends->sensor().format();
    auto extents = algo::extents_of_frame(format.width_px, format.height_px, config.inspection.bins_i, config.inspection.bins_j);
    if (!extents) return tl::unexpected(extents.error());
    InspectorSettings settings;
    settings.extents = *extents;
    settings.bits = format.bits;
    settings.threads = config.inspection.threads;
    settings.queue = config.inspection.queue;
    settings.observer = this;
    if (!config.inspection.recipe.empty()) {
        auto recipe = load_recipe(config.inspection.recipe);
        if (!recipe) return tl::unexpected(recipe.error());
        settings.recipe = std::move(*recipe);
    }
    auto made = make_threaded_inspector(*loop, settings);
    if (!made) return tl::unexpected(made.error());
    inspector = std::move(*made);

    station = std::make_unique<Station>(
        config.core,
        Cell{*loop, backends->part_sensor(), backends->strobe(), backends->sensor(), backends->rejector(), *inspector}, this);
    publish_again();
    return {};
}

Service::Service(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Service::~Service() = default;

Result<std::unique_ptr<Service>> Service::open(const Config& config, const SimulationOptions& simulation, ServiceWatchers watchers) {
    auto parts = std::make_unique<Parts>();
    parts->watchers = std::move(watchers);
    if (auto done = parts->open(config, simulation); !done) return tl::unexpected(done.error());
    return std::unique_ptr<Service>(new Service(std::move(parts)));
}

Result<void> Service::run() {
    parts_->loop->call_after(kLineWaits, [this] { parts_->backends->start_line(); });
    parts_->station->run();
    return parts_->loop->run();
}

void Service::stop() { parts_->loop->request_stop(); }
SdEventLoop& Service::loop() { return *parts_->loop; }
Backends& Service::backends() { return *parts_->backends; }
Snapshot Service::snapshot() const { return parts_->station->snapshot(); }
std::string Service::registers_address() const { return fmt::format("{}:{}", parts_->host, parts_->server->port()); }

}  // namespace hord::firmware
