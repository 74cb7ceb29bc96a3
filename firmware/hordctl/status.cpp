// hordctl status: what a running station says of itself, over Modbus, local or remote.
#include <chrono>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "firmware/hordctl/commands.h"
#include "firmware/modbus/client.h"
#include "firmware/registers.h"

namespace hord::firmware {
namespace {

using Json = nlohmann::ordered_json;

struct StatusOptions {
    std::string modbus = "127.0.0.1:1502";
    int timeout_ms = 1000;
    bool json = false;
};

constexpr BlockId kShown[] = {BlockId::ident, BlockId::status, BlockId::counters, BlockId::last};

Json to_json(const std::vector<Reading>& readings) {
    Json block;
    for (const Reading& reading : readings) {
        const std::string name(reading.what->name);
        if (reading.number) {
            block[name] = *reading.number;
        } else if (reading.what->type == RegisterType::text) {
            block[name] = reading.text;
        } else {
            block[name] = nullptr;
        }
    }
    return block;
}

Exit run_status(const StatusOptions& options) {
    auto endpoint = modbus::parse_endpoint(options.modbus);
    if (!endpoint) return complain(endpoint.error());
    auto client = modbus::Client::connect(*endpoint, std::chrono::milliseconds(options.timeout_ms));
    if (!client) return complain(client.error());
    Json json;
    for (const BlockId id : kShown) {
        const auto readings = client->read_block(id);
        if (!readings) return complain(readings.error());
        const std::string name(find_block(id)->name);
        if (options.json) {
            json[name] = to_json(*readings);
            continue;
        }
        fmt::print("{}\n", name);
        for (const Reading& reading : *readings) {
            fmt::print("  {:<24} {} {}\n", reading.what->name, reading.text, reading.text == "-" ? "" : reading.what->unit);
        }
    }
    if (options.json) fmt::print("{}\n", json.dump());
    return Exit::good;
}

}  // namespace

void add_status(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("status", "What a running station says of itself, over Modbus");
    auto options = std::make_shared<StatusOptions>();
    command->add_option("--modbus", options->modbus, "The station's register server, HOST[:PORT]")->capture_default_str();
    command->add_option("--timeout", options->timeout_ms, "Longest wait for an answer, ms")->check(CLI::Range(1, 60000))->capture_default_str();
    command->add_flag("--json", options->json, "Print one JSON object");
    command->footer("Example: hordctl status --modbus 192.168.1.20:502");
    command->callback([options, &status] { status = run_status(*options); });
}

}  // namespace hord::firmware
