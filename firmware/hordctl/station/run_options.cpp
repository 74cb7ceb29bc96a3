#include "firmware/hordctl/station/run_options.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "common/cli/program.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware {
namespace {

// An endpoint as a client's; port 0: any free one.
Result<modbus::Endpoint> parse_listen(const std::string& text) {
    const bool any_port = text.size() > 2 && text.ends_with(":0");
    const auto endpoint = modbus::parse_endpoint(any_port ? text.substr(0, text.size() - 2) : text);
    if (!endpoint) return tl::unexpected(endpoint.error());
    return modbus::Endpoint{endpoint->host, any_port ? std::uint16_t{0} : endpoint->port};
}

// The configuration of a run without a file: every wait as long as the rate of parts allows, because the machine may be
// busy with other work. The camera is far behind the part sensor. The pulse takes four fifths of the gap between two
// parts, and begins half a pulse before its part is at the ejector.
Config with_room(double parts_per_second) {
    Config config;
    CoreConfig& core = config.core;
    core.exposure_delay = milliseconds(100);
    if (parts_per_second > 20) return config;
    const Duration pitch = std::min(Duration(static_cast<std::int64_t>(1e9 / parts_per_second)), milliseconds(1000));
    core.exposure_delay = std::max(core.exposure_delay, pitch);
    core.transport = std::max(milliseconds(1000), 3 * pitch);
    core.trigger_lead = core.reject_pulse = pitch * 4 / 5;
    core.reject_early = pitch * 2 / 5;
    core.min_gap = pitch * 9 / 10;
    core.confirm_timeout = std::max(core.confirm_timeout, pitch);
    drivers::ModbusRejectorOptions module;
    module.response_timeout = std::max(module.response_timeout, pitch);
    config.rejector = SimulatedRejector{std::move(module)};
    return config;
}

// Parts that are not drawn have no share of good ones and no variety: both options would have no effect.
Result<void> check_parts(const RunOptions& options, const SensorConfig& sensor) {
    const auto refuse = [](const char* option, const std::string& why) {
        return fail(ErrorCode::invalid_argument, std::string(option) + " has no effect: " + why, "leave it out");
    };
    if (const auto* const drawn = std::get_if<SimulatedSensor>(&sensor)) {
        if (options.variety_given && !drawn->scenes.empty())
            return refuse("--variety", "the parts are the scenes of " + drawn->scenes.string());
        return {};
    }
    const auto* const recorded = std::get_if<FrameFolder>(&sensor);
    const std::string why = recorded != nullptr ? "the frames are those of " + recorded->folder.string()
                                                : "the frames come from a camera (sensor.backend)";
    if (options.good_given) return refuse("--good", why);
    if (options.variety_given) return refuse("--variety", why);
    return {};
}

}  // namespace

Result<Config> config_of_run(const RunOptions& options) {
    if (options.config.empty() && !options.simulate)
        return fail(ErrorCode::invalid_argument, "neither --config nor --simulate is given",
                    "give --config FILE for the devices of this machine, or --simulate");
    if (auto fine = check_outputs({{"--vitals", options.vitals}}, {options.config}); !fine)
        return tl::unexpected(fine.error());
    auto config = options.config.empty()
        ? with_room(options.line.parts_per_second)
        : load_config(options.config, options.simulate ? NamedBackends::optional : NamedBackends::required);
    if (!config) return config;
    if (options.simulate && !std::holds_alternative<SimulatedSensor>(config->sensor))
        config->sensor = SimulatedSensor{};
    if (auto fine = check_parts(options, config->sensor); !fine) return tl::unexpected(fine.error());
    if (!options.modbus.empty()) {
        auto listen = parse_listen(options.modbus);
        if (!listen) return tl::unexpected(listen.error());
        config->modbus.host = listen->host;  // who may read and write stays as configured
        config->modbus.port = listen->port;
    }
    return config;
}

}  // namespace hord::firmware
