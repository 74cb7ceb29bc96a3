// While the service runs: results, states and monitors go to registers, recorder and watchers.
#include <algorithm>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/monitoring/optics_report.h"
#include "firmware/service/service_components.h"

namespace hord::firmware {
namespace {

// Period of publishing heartbeats and the number of parts on the line; results and states are published at once.
constexpr Duration kPublishEvery = milliseconds(50);
constexpr Duration kHealthEvery = milliseconds(1000);
constexpr const char* kProcessorMillidegrees = "/sys/class/thermal/thermal_zone0/temp";

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

// Publishes every result once, in order; several may have been completed since the last call.
void Service::Components::publish() {
    registers->publish(station->snapshot(), unpublished);
    unpublished.clear();
}

void Service::Components::publish_again() {
    plc_interface->check_plc_heartbeat();
    publish();
    (void)command_handler->use_learned_reference();
    loop->call_after(kPublishEvery, [this] { publish_again(); });
}

void Service::Components::on_result(const PartResult& result) {
    if (recorder) recorder->on_result(result);
    const auto lost = static_cast<std::uint32_t>(result.reason == PartReason::frame_lost);
    const auto corrupt = static_cast<std::uint32_t>(result.reason >= PartReason::frame_stale &&
                                                    result.reason <= PartReason::frame_corrupt);
    health.frames_lost = health.frames_lost.value_or(0) + lost;
    health.frames_corrupt = health.frames_corrupt.value_or(0) + corrupt;
    unpublished.push_back(result);
    loop->post([this] { publish(); });  // after the core's step
    if (watchers.result) watchers.result(result);
}

void Service::Components::on_state(State from, State to) {
    loop->post([this] {
        publish();
        (void)command_handler->use_learned_reference();
    });
    if (to == State::continuous_execution || to == State::single_execution) {
        if (!occupancy_marker.left_behind()) occupancy_marker.raise();
        backends->start_line();
        backends->feed_line(true);
    } else if (executing(from)) {
        backends->feed_line(false);
    }
    if (watchers.state) watchers.state(from, to);
}

void Service::Components::on_trouble(const Error& error) {
    if (watchers.trouble) watchers.trouble(error);
}

void Service::Components::on_inspection(std::uint32_t part, const FrameView& frame,
                                        const algo::Inspection& inspection) {
    if (recorder) recorder->on_inspection(part, frame, inspection);
    if (teach_in) teach_in->on_inspection(part, frame, inspection);
    if (watchers.inspection) watchers.inspection(part, frame, inspection);
    if (drift && drift->add(frame)) loop->post([this] { on_drift(); });
    if (optics && part != Station::kTestPart && optics->add(frame, inspection)) loop->post([this] { on_optics(); });
}

// Drift was detected, or is over.
void Service::Components::on_drift() {
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
    report_faults();
}

// A fault of light or optics came or went, or the largest dust speck is another one.
void Service::Components::on_optics() {
    const OpticsMonitor::View view = optics->view();
    const std::uint32_t news = optics->news();
    for (const FaultInfo& fault : kFaultTable) {
        if ((news & fault.bit) != 0 && watchers.trouble) watchers.trouble(describe(fault.bit, view));
    }
    optics_faults = view.faults;
    health.optics = report_of(view);
    registers->publish(health);
    report_faults();
}

void Service::Components::report_faults() {
    station->outside_faults(store_faults | drift_fault | optics_faults);
    publish();
}

void Service::Components::publish_calibration() {
    calibration.drift_px = drift->view().largest_px;
    if (grid) calibration.age_s = grid->age_s();
    registers->publish(calibration);
}

void Service::Components::on_recipe(const NumberedRecipe& recipe) {
    registers->publish(RecipeInUse{recipe.number, crc32_of(recipe), ShortText(recipe.recipe.name)});
    optics->restart(recipe.recipe.lenslet_mm);  // the statistics of parts belong to the old recipe
    if (optics_faults != 0) loop->post([this] { on_optics(); });
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

}  // namespace hord::firmware
