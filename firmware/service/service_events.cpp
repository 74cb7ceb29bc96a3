// While the service runs: passes results, states and monitors' reports to registers, recorder and watchers.
#include <algorithm>
#include <fstream>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

// Period of publishing heartbeats and the number of parts on the line; results and states are published at once.
constexpr Duration kPublishEvery = milliseconds(50);
constexpr Duration kHealthEvery = milliseconds(1000);
constexpr Duration kTellBoundedEvery = milliseconds(600'000);
constexpr const char* kProcessorMillidegrees = "/sys/class/thermal/thermal_zone0/temp";

std::optional<double> processor_celsius() {
    std::ifstream in(kProcessorMillidegrees);
    double millidegrees = 0;
    return in >> millidegrees ? std::optional(millidegrees / 1000) : std::nullopt;
}

}  // namespace

// Publishes every result once, in order; several may have been completed since the last call.
void Service::publish() {
    registers_->publish(station_->snapshot(), unpublished_);
    unpublished_.clear();
}

void Service::publish_again() {
    plc_interface_->check_plc_heartbeat();
    publish();
    (void)command_handler_->use_learned_reference();
    loop_->call_after(kPublishEvery, [this] { publish_again(); });
}

void Service::on_result(const PartResult& result) {
    if (recorder_) recorder_->on_result(result);
    if (result.reason == PartReason::frame_lost) ++*health_.frames_lost;
    if (result.reason >= PartReason::frame_stale && result.reason <= PartReason::frame_corrupt)
        ++*health_.frames_corrupt;
    unpublished_.push_back(result);
    loop_->post([this] { publish(); });  // after the core's step
    if (watchers_.result) watchers_.result(result);
}

void Service::on_fault(std::uint32_t raised, const Snapshot& now) {
    if (watchers_.fault) watchers_.fault(raised, now);
}

void Service::on_state(State from, State to) {
    loop_->post([this] {
        publish();
        (void)command_handler_->use_learned_reference();
    });
    if (to == State::continuous_execution || to == State::single_execution) {
        if (!proof_withdrawn_) withdraw_proof();
        if (!proof_withdrawn_) station_->line_unknown();
        backends_->start_line();
        backends_->feed_line(true);
    } else if (executing(from)) {
        backends_->feed_line(false);
    }
    if (watchers_.state) watchers_.state(from, to);
}

void Service::on_step(State before, const Event& event) {
    const auto* const command = std::get_if<Command>(&event);
    const bool looked_after = (before == State::error || before == State::halted) && station_->core().state() != before;
    if (looked_after && command != nullptr && *command == Command::reset) backends_->clear_line();
}

void Service::on_trouble(const Error& error) {
    if (watchers_.trouble) watchers_.trouble(error);
}

void Service::on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) {
    if (recorder_) recorder_->on_inspection(part, frame, inspection);
    if (teach_in_) teach_in_->on_inspection(part, frame, inspection);
    if (watchers_.inspection) watchers_.inspection(part, frame, inspection);
    if (inspection.bounded) loop_->post([this, out_of_time = inspection.out_of_time] { on_bounded(out_of_time); });
    if (drift_ && drift_->add(frame, inspection.dark_dn)) loop_->post([this] { on_drift(); });
    if (optics_ && part != Station::kTestPart && optics_->add(frame, inspection)) loop_->post([this] { on_optics(); });
}

void Service::on_bounded(bool out_of_time) {
    health_.bounded = *health_.bounded + 1;
    const Duration now = loop_->now() - opened_at_;
    if (bounded_told_ && now - *bounded_told_ < kTellBoundedEvery) return;
    bounded_told_ = now;
    on_trouble({ErrorCode::timeout,
                fmt::format("an inspection reached its limit of {}: parts are judged by upper bounds and may be "
                            "rejected needlessly ({} since the start)",
                            out_of_time ? "time (timing.inspect_budget_ms)" : "work", *health_.bounded),
                "see what the frames show: noise, fog or a dark level that is too low (hordctl inspect, dark_dn)"});
}

// Drift was detected, or is over.
void Service::on_drift() {
    const DriftMonitor::View view = drift_->view();
    if (view.noticed) {
        on_trouble({ErrorCode::invalid_argument,
                    fmt::format("the lenslet grid has moved by {:.2f} px since {}", *view.largest_px,
                                view.since_calibration ? "the calibration" : "the first parts"),
                    std::string(info_of(kFaultGridDrift).cure)});
    }
    drift_fault_ = view.noticed ? std::uint32_t{kFaultGridDrift} : 0U;
    publish_calibration();
    report_faults();
}

// A fault of light or optics came or went, or the largest dust speck is another one.
void Service::on_optics() {
    const OpticsMonitor::View view = optics_->view();
    const std::uint32_t news = optics_->news();
    for (const FaultInfo& fault : kFaultTable) {
        if ((news & fault.bit) != 0) on_trouble(describe(fault.bit, view));
    }
    optics_faults_ = view.faults;
    health_.optics = report_of(view);
    registers_->publish(health_);
    report_faults();
}

void Service::report_faults() {
    station_->outside_faults(store_faults_ | drift_fault_ | optics_faults_ | recipe_fault_);
    publish();
}

void Service::publish_calibration() {
    calibration_.drift_px = drift_->view().largest_px;
    if (grid_) calibration_.age_s = grid_->age_s();
    registers_->publish(calibration_);
}

void Service::on_recipe(const NumberedRecipe& recipe) {
    registers_->publish(RecipeInUse{recipe.number, crc32_of(recipe), ShortText(recipe.recipe.name)});
    optics_->restart(recipe.recipe.lenslet_mm);  // the statistics of parts belong to the old recipe
    if (optics_faults_ != 0) loop_->post([this] { on_optics(); });
}

void Service::publish_health_again() {
    health_.uptime_s =
        static_cast<std::uint32_t>(std::chrono::duration_cast<std::chrono::seconds>(loop_->now() - opened_at_).count());
    health_.frames_waiting = static_cast<std::uint16_t>(inspector_->waiting());
    modbus::ServerStatistics all = server_->statistics();
    if (read_only_server_) {
        const modbus::ServerStatistics more = read_only_server_->statistics();
        all.connections += more.connections;
        all.requests += more.requests;
        all.exceptions += more.exceptions;
        all.evicted += more.evicted;
        all.broken += more.broken;
    }
    const auto counted = [](std::uint64_t n) {
        return static_cast<std::uint32_t>(std::min<std::uint64_t>(n, 0xFFFFFFFE));
    };
    health_.modbus_connections = counted(all.connections);
    health_.modbus_requests = counted(all.requests);
    health_.modbus_exceptions = counted(all.exceptions);
    health_.modbus_evicted = counted(all.evicted);
    health_.modbus_broken = counted(all.broken);
    health_.processor_celsius = processor_celsius();
    health_.disk_free_percent = store_disk_free_percent(config_);
    health_.optics = report_of(optics_->view());
    registers_->publish(health_);
    publish_calibration();
    loop_->call_after(kHealthEvery, [this] { publish_health_again(); });
}

}  // namespace hord::firmware
