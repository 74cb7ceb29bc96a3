// hordctl selftest: with --config or --simulate tests the configured devices; otherwise requests the self-test of a
// running station.
#include <algorithm>
#include <chrono>
#include <memory>

#include <fmt/format.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/core/faults.h"
#include "firmware/devices/device_probe.h"
#include "firmware/diagnostics/inspection_self_test.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/registers/register_map.h"
#include "firmware/service/station_files.h"

namespace hord::firmware {
namespace {

constexpr auto kPatience = std::chrono::seconds(10);

struct SelftestOptions {
    RemoteOptions remote;
    std::string config;
    bool simulate = false, actuate = false;
};

Exit ask_station(const RemoteOptions& options) {
    auto client = connect(options);
    if (!client) return complain(client.error());
    const auto reply = client->command(Command::self_test, 0, 0, kPatience);
    if (!reply) return complain(reply.error());
    if (reply->state == CommandState::completed) {
        fmt::print("self-test passed: judgement, light, sensor and light level are good\n");
        return Exit::good;
    }
    if (reply->error != CommandError::failed && reply->error != CommandError::device_down) {
        return complain({ErrorCode::refused, "self-test refused: " + reply->error_name, reply->cure()});
    }
    for (const FaultInfo& fault : kFaultTable) {
        if ((reply->result & fault.bit) != 0) fmt::print("{}: {}\n  {}\n", fault.name, fault.meaning, fault.cure);
    }
    return Exit::rejected;
}

Exit test_devices(const SelftestOptions& options) {
    const auto config = options.config.empty() ? Config{} : load_config(options.config);
    if (!config) return complain(config.error());
    Config read = *config;
    if (options.simulate) {  // its sensor is another one
        read.sensor = SimulatedSensor{};
        read.inspection.grid.clear();
    }
    const auto files = read_station_files(read);
    if (!files) return complain(files.error());
    auto loop = SdEventLoop::open();
    if (!loop) return complain(loop.error());
    auto each = open_each_device(**loop, *config, files->recipe.recipe, files->calibration, options.simulate);
    if (!each) return complain(each.error());

    std::vector<CheckRow> rows;
    const auto judged = check_judgement(config->inspection.bins_i, config->inspection.bins_j, 8);
    rows.push_back(
        judged
            ? CheckRow{"judgement", CheckRow::Result::good, "a drawn good part passes, a drawn bad one is rejected", {}}
            : CheckRow{"judgement", CheckRow::Result::bad, judged.error().what, judged.error().cure});
    DeviceDiagnosticsOptions check;
    check.actuate = options.actuate;
    check.wait = [&](const std::function<bool()>& done, hal::Duration patience) {
        return (*loop)->run_until(done, patience);
    };
    for (CheckRow& row : check_cell(**loop, each->cell, check)) rows.push_back(std::move(row));
    fmt::print("{}", table_of(rows));
    const auto wrong = std::ranges::count(rows, CheckRow::Result::bad, &CheckRow::result);
    if (wrong == 0) return Exit::good;
    fmt::print("\n{} of {} rows are bad\n", wrong, rows.size());
    return Exit::rejected;
}

}  // namespace

void add_selftest(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "selftest", "Test a cell's devices (--config, --simulate), or have a running station test itself");
    auto options = std::make_shared<SelftestOptions>();
    auto* config = command->add_option("--config", options->config,
                                       "Open what this configuration names, one by one; the service must not run");
    auto* simulate =
        command->add_flag("--simulate", options->simulate, "The simulated cell and a coil module on loopback instead");
    auto* actuate =
        command->add_flag("--actuate", options->actuate,
                          "Pulse the ejector, too: only with the line clear. Without, outputs are only read");
    add_remote_options(*command, options->remote);
    command->footer(
        "Tests of devices pulse each light once and take one frame with light and one without, of the empty field.\n"
        "Exit status: 0 passed, 1 something is wrong (named with its cure), 2 bad configuration, refused or not "
        "reached.\n"
        "Example: hordctl selftest --config /etc/hord/hordd.toml\n"
        "Example: hordctl selftest --modbus 192.168.1.20:502");
    command->callback([options, config, simulate, actuate, &status] {
        const bool devices = config->count() > 0 || simulate->count() > 0;
        if (actuate->count() > 0 && !devices) {
            status = complain(
                {ErrorCode::invalid_argument, "--actuate tests devices", "give --config FILE or --simulate, too"});
        } else if (devices && options->remote.given->count() > 0) {
            status = complain({ErrorCode::invalid_argument,
                               "--modbus asks a station, --config and --simulate test devices", "give one of them"});
        } else {
            status = devices ? test_devices(*options) : ask_station(options->remote);
        }
    });
}

}  // namespace hord::firmware
