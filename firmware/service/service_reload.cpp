// Reload: applies another configuration while the service runs.
#include <utility>

#include "firmware/service/service_components.h"

namespace hord::firmware {
namespace {

bool same_servers(const TcpServer& a, const TcpServer& b) {
    return a.host == b.host && a.port == b.port && a.read_only_port == b.read_only_port &&
        a.max_connections == b.max_connections;
}

}  // namespace

Result<std::vector<std::string>> Service::Components::reload(const Config& next) {
    // The recipe first: nothing else can fail.
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
            if (auto used = command_handler->use({}, std::move(recipe)); !used) {
                configured_recipe = before;
                return tl::unexpected(used.error());
            }
        }
    }
    server->set_access(next.modbus.access);
    if (read_only_server) read_only_server->set_access(next.modbus.access);
    plc_interface->set_timeout(next.plc.timeout);
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
    restart(!same_servers(next.modbus, config.modbus), "[modbus] addresses, ports or connections");
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

}  // namespace hord::firmware
