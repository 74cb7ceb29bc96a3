// Connects to a station over Modbus, local or remote, and sends it commands.
#pragma once

#include <string>

#include "firmware/hordctl/commands.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware {

struct RemoteOptions {
    std::string modbus = "127.0.0.1:1502";  // not given: at 502 (the installed service) or 1502 (hordctl run)
    const CLI::Option* given = nullptr;
    int timeout_ms = 1000;
};

// --modbus and --timeout.
void add_remote_options(CLI::App& command, RemoteOptions& options);

Result<modbus::Client> connect(const RemoteOptions& options);

// Sends one command and prints the result; a refusal is printed to stderr with its name. 0 done, 2 refused or not
// reached.
Exit send_command(const RemoteOptions& options, Command code, std::uint32_t argument = 0, std::uint32_t argument2 = 0);

}  // namespace hord::firmware
