// hord-safe: systemd runs it after hordd has ended in any way. A program of its own because it must be quick: loading
// hordd's libraries takes longer than everything here.
#include <cstdio>
#include <string>

#include <fmt/format.h>

#include "common/cli/program.h"
#include "firmware/devices/safe_state.h"
#include "firmware/service/journal.h"

int main(int argc, char** argv) {
    using namespace hord::firmware;
    std::string file = "/etc/hord/hordd.toml";
    CLI::App program{
        "hord-safe: turns the station's lights off and brings its rejector to the safe state, no run permit"};
    program.set_version_flag("--version", "hord-safe " HORD_VERSION);
    program.add_option("--config", file, "The station's configuration (TOML)")->capture_default_str();
    program.footer(
        "Exit status: 0 safe, 2 not: look at the line, or usage, 78 the configuration cannot be used.\nExample: "
        "hord-safe --config /etc/hord/hordd.toml");
    if (const auto ended = hord::parse_command_line(program, argc, argv)) return *ended;
    const auto config = load_config(file);
    if (!config) {
        write_to_journal(entry_of(JournalEvent::configuration_refused), config.error().message());
        return 78;
    }
    if (const auto safe = make_safe(*config, kSafePatience); !safe) {
        write_to_journal(entry_of(JournalEvent::trouble), safe.error().message());
        return 2;
    }
    return 0;
}
