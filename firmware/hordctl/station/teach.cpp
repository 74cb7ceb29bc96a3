// hordctl teach: a reference from the next parts of the running line.
#include <chrono>

#include <fmt/format.h>

#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

struct TeachOptions {
    std::uint32_t parts = 16;
    int patience_s = 600;
    RemoteOptions remote;
};

std::string cure_of_teach(const modbus::Client::Reply& refused) {
    switch (refused.error) {
        case CommandError::not_yet:
            return "a teach is under way, or its reference waits for the line to stop and be empty";
        case CommandError::not_supported:
            return "the station has no state folder to keep a reference in: run it as a service, or with --state";
        default: return refused.cure();
    }
}

Exit run_teach(const TeachOptions& options) {
    auto client = connect(options.remote);
    if (!client) return complain(client.error());
    const auto reply = client->command(Command::teach, options.parts, 0, std::chrono::seconds(options.patience_s));
    if (!reply) {
        Error error = reply.error();
        if (error.code == ErrorCode::timeout) {
            error.cure =
                "the station goes on with it: see that parts come (hordctl watch), and what came of it in its journal; "
                "hordctl command abort ends it";
        }
        return complain(error);
    }
    if (reply->state != CommandState::completed) {
        const std::string& why = reply->remarks.empty() ? reply->error_name : reply->remarks;
        return complain({ErrorCode::refused, "not taught: " + why, cure_of_teach(*reply)});
    }
    const auto in_use = client->read(find_register(BlockId::status, "recipe_crc32")->address, 2);
    const bool now = in_use && (std::uint32_t{(*in_use)[0]} << 16U | (*in_use)[1]) == reply->result;
    fmt::print("taught: the recipe with its reference, CRC-32 {:08X}, is {}\n", reply->result,
               now ? "in use" : "in use as soon as the line is stopped and empty");
    if (!reply->remarks.empty()) {
        fmt::print("{}\nLook at parts that it names; if they are good, teach again with more parts.\n", reply->remarks);
        if (reply->remarks.ends_with("...")) fmt::print("The station's journal has the rest (journalctl -u hordd).\n");
    }
    return Exit::good;
}

}  // namespace

void add_teach(CLI::App& program, Exit& status) {
    auto* command =
        program.add_subcommand("teach", "Have a station learn its reference from the next parts of the running line");
    auto options = std::make_shared<TeachOptions>();
    add_number(*command, "--parts", options->parts, "As many parts; they have to be good", 8, 64);
    add_number(*command, "--patience", options->patience_s,
               "Longest wait for its end, s; the station goes on without anybody waiting", 1, 86400);
    add_remote_options(*command, options->remote);
    command->footer(
        "The station must list this address in modbus.may_write. Exit status: 0 taught, 2 refused, failed (its journal "
        "says why) or not reached.\n"
        "Example: hordctl teach --parts 24 --modbus 192.168.1.20:502");
    command->callback([options, &status] { status = run_teach(*options); });
}

}  // namespace hord::firmware
