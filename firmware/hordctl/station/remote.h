// A station at the other end of Modbus, local or remote: how to name it, and how to command it.
#pragma once

#include <string>

#include "firmware/hordctl/commands.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware {

struct RemoteOptions {
    std::string modbus =
        "127.0.0.1:1502";  // not given: this machine's, at 502 (the installed service) or 1502 (hordctl run)
    const CLI::Option* given = nullptr;
    int timeout_ms = 1000;
};

// --modbus and --timeout.
void add_remote_options(CLI::App& command, RemoteOptions& options);

// What a person does about a refused command.
const char* cure_of(CommandError error);

Result<modbus::Client> connect(const RemoteOptions& options);

// Sends one command and prints what came of it; a refusal goes to stderr with its name. 0 done, 2 refused or not
// reached.
Exit send_command(const RemoteOptions& options, Command code, std::uint32_t argument = 0, std::uint32_t argument2 = 0);

}  // namespace hord::firmware
