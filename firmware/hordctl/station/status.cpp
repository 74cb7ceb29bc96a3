// hordctl status: prints the registers of a running station, over Modbus, local or remote.
#include <cmath>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware {
namespace {

using store::Json;

struct StatusOptions {
    RemoteOptions remote;
    bool json = false;
};

constexpr BlockId kShown[] = {BlockId::ident, BlockId::status, BlockId::counters, BlockId::last,
                              BlockId::plc,   BlockId::recipe, BlockId::health,   BlockId::calibration};

Json number_json(const Reading& reading) {
    const double value = *reading.number;
    if (reading.what->scale == 1 && std::abs(value) < 9e15) return static_cast<std::int64_t>(std::llround(value));
    return value;
}

// A value that the station does not know is null; a text may be empty. A value with names also has NAME_text.
Json to_json(const std::vector<Reading>& readings) {
    Json block;
    for (const Reading& reading : readings) {
        const std::string name(reading.what->name);
        Json& value = block[name];
        if (reading.number) value = number_json(reading);
        else if (reading.what->type == RegisterType::text) value = reading.text;
        if (!reading.number || reading.what->values.empty()) continue;
        // "6 Ready": the name alone.
        const bool bits = reading.what->type == RegisterType::bits16 || reading.what->type == RegisterType::bits32;
        const auto space = bits ? std::string::npos : reading.text.find(' ');
        block[name + "_text"] = space == std::string::npos ? reading.text : reading.text.substr(space + 1);
    }
    return block;
}

Json faults_json(std::uint32_t active, std::uint32_t latched) {
    Json faults = Json::array();
    for (const FaultInfo& fault : kFaultTable) {
        if (((active | latched) & fault.bit) == 0) continue;
        faults.push_back({{"name", fault.name},
                          {"active", (active & fault.bit) != 0},
                          {"latched", (latched & fault.bit) != 0},
                          {"meaning", fault.meaning},
                          {"cure", fault.cure}});
    }
    return faults;
}

Exit run_status(const StatusOptions& options) {
    auto client = connect(options.remote);
    if (!client) return complain(client.error());
    Json json;
    std::uint32_t active = 0, latched = 0;
    for (const BlockId id : kShown) {
        const auto readings = client->read_block(id);
        if (!readings) return complain(readings.error());
        const std::string name(find_block(id)->name);
        for (const Reading& reading : *readings) {
            if (!reading.number) continue;
            if (reading.what->name == "faults_active") active = static_cast<std::uint32_t>(*reading.number);
            if (reading.what->name == "faults_latched") latched = static_cast<std::uint32_t>(*reading.number);
        }
        if (options.json) {
            json[name] = to_json(*readings);
            continue;
        }
        fmt::print("{}\n", name);
        for (const Reading& reading : *readings) {
            fmt::print("  {:<24} {} {}\n", reading.what->name, reading.text,
                       reading.text == "-" ? "" : reading.what->unit);
        }
    }
    json["faults"] = faults_json(active, latched);
    if (options.json) fmt::print("{}\n", store::to_text(json));
    for (const FaultInfo& fault : kFaultTable) {
        if (!options.json && (active & fault.bit) != 0)
            fmt::print("FAULT {}: {}\n  {}\n", fault.name, fault.meaning, fault.cure);
    }
    return Exit::good;
}

}  // namespace

void add_status(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("status", "What a running station says of itself, over Modbus");
    auto options = std::make_shared<StatusOptions>();
    add_remote_options(*command, options->remote);
    command->add_flag("--json", options->json, "Print one JSON object");
    command->footer("Example: hordctl status --modbus 192.168.1.20:502");
    command->callback([options, &status] { status = run_status(*options); });
}

}  // namespace hord::firmware
