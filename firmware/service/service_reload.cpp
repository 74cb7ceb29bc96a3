// Reload: applies another configuration while the service runs.
#include <utility>

#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

bool same_servers(const TcpServer& a, const TcpServer& b) {
    return a.host == b.host && a.port == b.port && a.read_only_port == b.read_only_port &&
        a.max_connections == b.max_connections;
}

}  // namespace

Result<std::vector<std::string>> Service::reload(const Config& next) {
    // The recipe first: nothing else can fail.
    std::vector<std::string> waiting;
    auto recipe = recipe_or_default(next.inspection.recipe);
    if (!recipe) return tl::unexpected(recipe.error());
    if (const std::uint32_t crc = crc32_of(*recipe); crc != configured_recipe_) {
        if (executing(station_->core().state())) {
            waiting.emplace_back("inspection.recipe (stop the station, then reload again)");
        } else {
            const std::uint32_t before = std::exchange(configured_recipe_, crc);
            if (auto used = command_handler_->use({}, std::move(*recipe)); !used) {
                configured_recipe_ = before;
                return tl::unexpected(used.error());
            }
        }
    }
    server_->set_access(next.modbus.access);
    if (read_only_server_) read_only_server_->set_access(next.modbus.access);
    plc_interface_->set_timeout(next.plc.timeout);
    config_.inspection.recipes = next.inspection.recipes;
    config_.inspection.recipe = next.inspection.recipe;
    config_.modbus.access = next.modbus.access;
    config_.plc = next.plc;

    const auto restart = [&](bool differs, const char* table) {
        if (differs) waiting.emplace_back(table);
    };
    CoreConfig other = next.core;
    other.plc_policy = config_.core.plc_policy;
    restart(next.name != config_.name || next.autostart != config_.autostart, "[station]");
    restart(other != config_.core, "[line], [timing] or [rejector]'s times");
    restart(next.core.plc_policy != config_.core.plc_policy, "plc.policy");
    restart(next.sensor != config_.sensor, "[sensor]");
    restart(next.strobe != config_.strobe, "[strobe]");
    restart(next.part_sensor != config_.part_sensor, "[part_sensor]");
    restart(next.rejector != config_.rejector, "[rejector]");
    restart(!same_servers(next.modbus, config_.modbus), "[modbus] addresses, ports or connections");
    restart(next.serial != config_.serial, "[serial]");
    restart(
        next.inspection.bins_i != config_.inspection.bins_i || next.inspection.bins_j != config_.inspection.bins_j ||
            next.inspection.threads != config_.inspection.threads || next.inspection.queue != config_.inspection.queue,
        "[inspection] macro, threads or queue");
    restart(next.inspection.grid != config_.inspection.grid, "inspection.grid");
    restart(next.inspection.budget != config_.inspection.budget, "timing.inspect_budget_ms");
    restart(next.optics != config_.optics, "[optics]");
    restart(next.store != config_.store, "[store]");
    if (recorder_) note_configuration(*recorder_, next);
    return waiting;
}

}  // namespace hord::firmware
