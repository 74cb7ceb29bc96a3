// hordctl devices: lists what is attached to this machine, with the lines for hordd.toml.
#include <charconv>
#include <filesystem>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/devices/device_inventory.h"
#include "firmware/hordctl/commands.h"

namespace hord::firmware {
namespace {

struct DevicesOptions {
    std::string module;
    int unit = 1;
    bool json = false;
    InventoryOptions inventory;
};

// "HOST[:PORT]"; an IPv6 address with a port is in brackets.
std::optional<drivers::ModuleAddress> parse_module(std::string text, int unit) {
    drivers::ModuleAddress address;
    address.unit = unit;
    std::string port;
    if (text.starts_with('[')) {
        const auto end = text.find(']');
        if (end == std::string::npos) return std::nullopt;
        port = text.substr(end + 1);
        text = text.substr(1, end - 1);
        if (!port.empty() && !port.starts_with(':')) return std::nullopt;
    } else if (const auto colon = text.find(':'); colon != std::string::npos && colon == text.rfind(':')) {
        port = text.substr(colon);
        text.resize(colon);
    }
    if (!port.empty()) {
        const auto read = std::from_chars(port.data() + 1, port.data() + port.size(), address.port);
        if (read.ec != std::errc() || read.ptr != port.data() + port.size()) return std::nullopt;
    }
    address.host = text;
    if (text.empty() || address.port < 1 || address.port > 65535) return std::nullopt;
    return address;
}

std::string indented(const std::string& text, const char* indent) {
    std::string out;
    for (std::size_t at = 0; at < text.size();) {
        const auto end = std::min(text.find('\n', at), text.size());
        out += indent + text.substr(at, end - at) + '\n';
        at = end + 1;
    }
    return out;
}

std::string joined(const std::vector<std::string>& words) {
    std::string out;
    for (const std::string& word : words) out += (out.empty() ? "" : ", ") + word;
    return out;
}

void print_item(const InventoryItem& item) {
    fmt::print("  {}{}{}\n", item.name, item.text.empty() ? "" : ": ", item.text);
    if (!item.holder.empty()) fmt::print("    in use by {}\n", item.holder);
    if (!item.problem.empty()) fmt::print("    {}\n", item.problem);
    if (!item.cure.empty()) fmt::print("    cure: {}\n", item.cure);
    for (const drivers::ListedLine& line : item.lines) {
        fmt::print("    line {:>3} {}{}{}\n", line.offset, line.name.empty() ? "without a name" : line.name,
                   line.output ? ", output" : "",
                   line.holder ? ", in use" + (line.holder->empty() ? "" : " by " + *line.holder) : "");
    }
    std::vector<std::string> unusable;
    for (const hal::ListedFormat& format : item.formats) {
        if (format.bits == 0) {
            unusable.push_back(format.name);
            continue;
        }
        fmt::print("    format {} ({} bits){}{}\n", format.name, format.bits, format.sizes.empty() ? "" : ": ",
                   joined(format.sizes));
    }
    if (!unusable.empty()) fmt::print("    formats that are not grey: {}\n", joined(unusable));
    if (!item.triggers.empty()) fmt::print("    triggers: {}\n", joined(item.triggers));
    if (!item.config.empty()) fmt::print("    for hordd.toml:\n{}", indented(item.config, "      "));
}

void print_text(const std::vector<InventorySection>& sections) {
    for (const InventorySection& section : sections) {
        fmt::print("{}\n", section.title);
        for (const InventoryItem& item : section.items) print_item(item);
        if (!section.items.empty()) continue;
        fmt::print("  {}\n  cure: {}\n", section.problem.empty() ? section.looked_for : section.problem, section.cure);
    }
}

nlohmann::json json_of(const InventoryItem& item) {
    nlohmann::json out{{"name", item.name}, {"text", item.text}};
    const auto add = [&](const char* key, const std::string& text) {
        if (!text.empty()) out[key] = text;
    };
    add("in_use_by", item.holder);
    add("problem", item.problem);
    add("cure", item.cure);
    add("config", item.config);
    for (const drivers::ListedLine& line : item.lines) {
        nlohmann::json one{{"offset", line.offset}, {"name", line.name}, {"output", line.output}};
        one["used"] = line.holder.has_value();
        if (line.holder) one["in_use_by"] = *line.holder;
        out["lines"].push_back(std::move(one));
    }
    for (const hal::ListedFormat& format : item.formats) {
        nlohmann::json one{{"name", format.name}, {"usable", format.bits > 0}, {"sizes", format.sizes}};
        if (format.bits > 0) one["bits"] = format.bits;
        out["formats"].push_back(std::move(one));
    }
    if (!item.triggers.empty()) out["triggers"] = item.triggers;
    return out;
}

void print_json(const std::vector<InventorySection>& sections) {
    nlohmann::json out{{"schema", 1}};
    for (const InventorySection& section : sections) {
        nlohmann::json& one = out[section.key];
        one["devices"] = nlohmann::json::array();
        for (const InventoryItem& item : section.items) one["devices"].push_back(json_of(item));
        if (!section.items.empty()) continue;
        one["problem"] = section.problem.empty() ? section.looked_for : section.problem;
        one["cure"] = section.cure;
    }
    fmt::print("{}\n", out.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
}

Exit list(const DevicesOptions& options) {
    InventoryOptions inventory = options.inventory;
    if (!options.module.empty()) {
        inventory.module = parse_module(options.module, options.unit);
        if (!inventory.module)
            return complain({ErrorCode::invalid_argument, fmt::format("--module {} is no address", options.module),
                             "give HOST or HOST:PORT, for example 192.168.1.30:502"});
    }
    const auto loop = SdEventLoop::open();
    if (!loop) return complain(loop.error());
    auto sections = list_devices(**loop, inventory);
    if (options.json) {
        print_json(sections);
    } else {
        const std::vector<std::string> missing = make_one_file(sections);
        print_text(sections);
        if (!missing.empty())
            fmt::print(
                "Not in the lines above, and needed in hordd.toml: {}\n  cure: attach the devices and list them again, "
                "or "
                "add each with backend = \"simulated\" for a trial\n",
                joined(missing));
    }
    const InventorySection& module = sections.back();
    return module.items.empty() || module.items.front().problem.empty() ? Exit::good : Exit::rejected;
}

}  // namespace

void add_devices(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "devices",
        "List what is attached: GPIO lines, cameras, serial ports, a Modbus module; with lines for hordd.toml");
    auto options = std::make_shared<DevicesOptions>();
    auto* const module =
        command
            ->add_option("--module", options->module,
                         "Also ask the Modbus module at HOST[:PORT] what it is; only reads")
            ->type_name("HOST[:PORT]")
            ->check([](const std::string& text) { return text.empty() ? "name the module: HOST[:PORT]" : ""; });
    command
        ->add_option_function<std::string>(
            "--modbus",
            [](const std::string&) {
                throw CLI::ValidationError(
                    "--modbus", "names a station in other commands; to ask a Modbus module, give --module HOST[:PORT]");
            })
        ->group("");  // not in the help
    add_number(*command, "--unit", options->unit, "The module's unit", 1, 255)->needs(module);
    command->add_flag("--json", options->json, "One JSON object");
    command->add_option("--root", options->inventory.root, "Look in this folder's dev, proc and sys")
        ->type_name("FOLDER")
        ->check([](const std::string& folder) {
            std::error_code error;
            return std::filesystem::is_directory(folder, error) ? "" : folder + " is no folder";
        })
        ->capture_default_str();
    command->footer(
        "No output moves, no light fires, no serial port is opened, and no camera is taken that another program "
        "holds.\n"
        "Run it as root to see who uses a device.\n"
        "Exit status: 0 listed, 1 the module did not say what it is, 2 wrong usage.\n"
        "Example: hordctl devices --module 192.168.1.30:502");
    command->callback([options, &status] { status = list(*options); });
}

}  // namespace hord::firmware
