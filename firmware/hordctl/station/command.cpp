// hordctl command: sends a station a command, as a PLC does.
#include <chrono>

#include <fmt/format.h>

#include "firmware/core/enum_values.h"
#include "firmware/core/states.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

constexpr auto kPatience = std::chrono::seconds(10);

struct CommandOptions {
    std::string name;
    RemoteOptions remote;
};

// Commands without arguments and with a short answer, under the names of the register map.
std::vector<std::string> plain_commands() {
    std::vector<std::string> names;
    for (const Command command : kValuesOf<Command>) {
        if (command != Command::commit_recipe && command != Command::use_recipe && command != Command::teach)
            names.emplace_back(name_of(command));
    }
    return names;
}

// "start-continuous" is accepted for "start_continuous".
std::string canonical_name(const std::string& typed) {
    const auto command = command_named(typed);
    return command ? std::string(name_of(*command)) : typed;
}

// Why `hordctl command` does not send this command; empty: it does, or knows none of this name.
std::string sent_otherwise(const std::string& typed) {
    switch (command_named(typed).value_or(Command{})) {
        case Command::use_recipe: return "use_recipe needs a number: call hordctl recipe use NUMBER";
        case Command::teach: return "teach has a command of its own: call hordctl teach";
        case Command::commit_recipe:
            return "a PLC sends commit_recipe (docs/plc.md); a file's: hordctl recipe use NUMBER";
        default: return {};
    }
}

State state_of(modbus::Client& station) {
    const auto state = station.read(find_register(BlockId::status, "state")->address, 1);
    return state ? static_cast<State>((*state)[0]) : State{};
}

bool has_faults(modbus::Client& station) {
    const auto faults = station.read(find_register(BlockId::status, "faults_active")->address, 2);
    return faults && ((*faults)[0] != 0 || (*faults)[1] != 0);
}

}  // namespace

void add_remote_options(CLI::App& command, RemoteOptions& options) {
    options.given =
        command.add_option("--modbus", options.modbus,
                           "The station's register server, HOST[:PORT]; without it this machine's, at 502 or 1502");
    add_number(command, "--timeout", options.timeout_ms, "Longest wait for an answer, ms", 1, 60000);
}

Result<modbus::Client> connect(const RemoteOptions& options) {
    const std::chrono::milliseconds timeout(options.timeout_ms);
    if (options.given == nullptr || options.given->count() == 0) {
        if (auto service = modbus::Client::connect({"127.0.0.1", 502}, timeout)) return service;
    }
    auto endpoint = modbus::parse_endpoint(options.modbus);
    if (!endpoint) return tl::unexpected(endpoint.error());
    return modbus::Client::connect(*endpoint, timeout);
}

Exit send_command(const RemoteOptions& options, Command code, std::uint32_t argument, std::uint32_t argument2) {
    auto client = connect(options);
    if (!client) return complain(client.error());
    const auto reply = client->command(code, argument, argument2, kPatience);
    if (!reply) return complain(reply.error());
    if (reply->state != CommandState::completed)
        return complain({ErrorCode::refused, "refused: " + reply->why(), reply->cure()});
    if (code == Command::reset && state_of(*client) == State::initialized && has_faults(*client))
        fmt::print("done; the line starts when every device is up: see hordctl status\n");
    else if (reply->result != 0) fmt::print("done, {:08X}\n", reply->result);
    else fmt::print("done\n");
    return Exit::good;
}

void add_command(CLI::App& program, Exit& status) {
    auto* command =
        program.add_subcommand("command", "Command a station: initialise, arm, start_continuous, stop, reset ...");
    auto options = std::make_shared<CommandOptions>();
    command->add_option("name", options->name, "What to do")
        ->required()
        ->check(CLI::Validator(sent_otherwise, ""))
        ->check(CLI::IsMember(plain_commands(), canonical_name));
    add_remote_options(*command, options->remote);
    command->footer(
        "The station must list this address in modbus.may_write. Exit status: 0 done, 2 refused or not reached.\n"
        "Example: hordctl command reset --modbus 192.168.1.20:502");
    command->callback([options, &status] {
        status = send_command(options->remote, command_named(options->name).value_or(Command{}));
    });
}

}  // namespace hord::firmware
