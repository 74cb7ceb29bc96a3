// hord-page: the station's web page, and /metrics. A process of its own that only reads: the line does not depend on
// it.
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <string>

#include <fmt/format.h>
#include <unistd.h>

#include "common/cli/message.h"
#include "common/cli/program.h"
#include "common/toml_fields.h"
#include "firmware/page/server.h"
#include "firmware/page/station_watch.h"
#include "firmware/page/wall.h"
#include "firmware/store/frames/frame_archive.h"

namespace {

using namespace hord;
using namespace hord::firmware;
using namespace hord::firmware::page;

constexpr int kBadConfiguration = 78, kCannotRun = 2;
constexpr auto kCommandTimeout = std::chrono::seconds(10);
constexpr auto kLightEvery = std::chrono::seconds(2);
constexpr auto kWallPoll = std::chrono::milliseconds(500);
constexpr auto kModbusTimeout = std::chrono::milliseconds(1000);

struct Options {
    std::string config = "/etc/hord/page.toml", modbus, store, listen, stations;
    const CLI::Option* config_given = nullptr;
    bool check = false;
};

int complain(const Error& error, int status) {
    print_message("hord-page: {}\n", error.message());
    return status;
}

// The configuration file (it may be missing unless it was named), overridden by the command line.
Result<PageConfig> configuration(const Options& options) {
    PageConfig config;
    if (options.config_given->count() > 0 || std::filesystem::exists(options.config)) {
        auto loaded = load_page_config(options.config);
        if (!loaded) return loaded;
        config = std::move(*loaded);
    }
    if (!options.modbus.empty()) config.modbus = options.modbus;
    if (!options.store.empty()) config.store = options.store;
    if (!options.listen.empty()) {
        const auto colon = options.listen.rfind(':'), bracket = options.listen.rfind(']');
        const bool has_port = colon != std::string::npos && (bracket == std::string::npos || colon > bracket);
        const bool any = options.listen.ends_with(":0");
        const auto endpoint =
            modbus::parse_endpoint(any ? options.listen.substr(0, options.listen.size() - 2) : options.listen);
        if (!endpoint || !has_port)
            return fail(ErrorCode::invalid_argument, "\"" + options.listen + "\" is no address to listen at",
                        "write HOST:PORT, for example 127.0.0.1:8070");
        config.host = endpoint->host;
        config.port = any ? std::uint16_t{0} : endpoint->port;
    }
    return config;
}

void log(const std::string& line) { print_message("hord-page: {}\n", line); }

// SIGINT and SIGTERM: blocked in all threads from here on; wait() receives them.
class EndSignals {
  public:
    EndSignals() {
        sigemptyset(&ends_);
        for (const int signal : {SIGINT, SIGTERM}) sigaddset(&ends_, signal);
        pthread_sigmask(SIG_BLOCK, &ends_, nullptr);
    }
    void wait() const {
        int signal = 0;
        sigwait(&ends_, &signal);
    }

  private:
    sigset_t ends_{};
};

// Several stations side by side. It commands nothing and reads no store.
int serve_wall(const PageConfig& config, std::vector<WallStation> stations) {
    const EndSignals ends;
    const std::size_t count = stations.size();
    Viewers viewers(0);
    Live live(viewers);
    Results results({});
    KeptFrames frames({});
    PartPictures pictures;
    const Tokens nobody;
    const Wall wall(std::move(stations), std::max(config.poll, kWallPoll));
    Pages pages({config, nobody, viewers, live, results, frames, pictures, {}, log, HORD_VERSION, &wall});
    auto server = PageServer::open(config, pages, viewers);
    if (!server) return complain(server.error(), kCannotRun);
    log(fmt::format("http://{}/ shows {} stations", (*server)->address(), count));
    ends.wait();
    return 0;
}

int serve(const PageConfig& config, const Tokens& tokens, const modbus::Endpoint& station) {
    const EndSignals ends;
    Viewers viewers(static_cast<std::size_t>(config.viewers));
    Live live(viewers);
    Results results(config.store);
    KeptFrames frames(config.store / store::kFramesFolder);
    PartPictures pictures;
    const auto command = [&](Command code, std::uint32_t argument, std::uint32_t argument2,
                             const std::string& who) -> Result<modbus::Client::Reply> {
        auto client = modbus::Client::connect(station, kModbusTimeout);
        if (!client) return tl::unexpected(client.error());
        return client->command(code, argument, argument2, kCommandTimeout, who);
    };
    Pages pages({config, tokens, viewers, live, results, frames, pictures, command, log, HORD_VERSION});
    auto server = PageServer::open(config, pages, viewers);
    if (!server) return complain(server.error(), kCannotRun);

    // Announces the frame of a new reject, and measures the brightness of kept frames. A frame is archived at its
    // verdict, its result is published past the ejector: the page shows a reject earlier.
    std::chrono::steady_clock::time_point light_at{};
    StationWatch watch(station, config.poll, live, [&] {
        if (const auto kept = frames.newest_reject()) {
            if (viewers.count() > 0) (void)pictures.draw(*kept, "");  // cached; a request reports its error
            live.set_picture(kept->metadata.boot, kept->metadata.part, kept->metadata.time_us / 1000);
        }
        const auto now = std::chrono::steady_clock::now();
        if (now - light_at < kLightEvery) return;
        light_at = now;
        if (const auto kept = frames.newest()) live.set_light(brightest_share(kept->frame.frame.view()));
    });
    log(fmt::format("http://{}/ shows the station at {}{}", (*server)->address(), config.modbus,
                    tokens.empty() ? "" : "; commands need a token"));
    if (!tokens.empty() && config.host != "127.0.0.1" && config.host != "localhost" && config.host != "::1") {
        log("tokens travel unencrypted beyond this machine: put a TLS proxy in front, see docs/page.md");
    }
    ends.wait();
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    Options options;
    CLI::App program{
        "hord-page: the station's page for a browser, and /metrics for Prometheus; reads registers, store and "
        "pictures, runs until SIGTERM"};
    program.set_version_flag("--version", "hord-page " HORD_VERSION);
    options.config_given =
        program.add_option("--config", options.config, "Configuration (TOML); where it does not exist, the defaults")
            ->capture_default_str();
    program.add_option("--listen", options.listen,
                       "Where the page is, HOST:PORT (port 0: any free one), instead of what the configuration says");
    program.add_option("--modbus", options.modbus,
                       "The station's register server, HOST[:PORT], instead of what the configuration says");
    program.add_option("--store", options.store, "The station's store, instead of what the configuration says");
    program.add_option("--stations", options.stations,
                       "Show several stations side by side, without their stores: a TOML file with [[station]] name, "
                       "modbus and page (the address of the station's own page)");
    program.add_flag("--check", options.check,
                     "Only read the configuration and the tokens, and say what is wrong with them");
    program.footer(
        "Exit status: 0 stopped as asked, 2 the port cannot be used, or usage, 78 the configuration cannot be used.\n"
        "Example: hord-page --modbus 127.0.0.1:1502 --store /var/lib/hord/store --listen 127.0.0.1:8070");
    if (const auto ended = hord::parse_command_line(program, argc, argv)) return *ended;
    never_wait_for_stderr();
    const auto config = configuration(options);
    if (!config) return complain(config.error(), kBadConfiguration);
    for (const std::string& file : {options.config, options.stations})
        if (const auto cut = common::may_have_lost_its_end(file)) log(cut->message());
    if (!options.stations.empty()) {
        auto stations = load_stations(options.stations);
        if (!stations) return complain(stations.error(), kBadConfiguration);
        if (!options.check) return serve_wall(*config, std::move(*stations));
        fmt::print("{} can be used: {} stations\n", options.stations, stations->size());
        return 0;
    }
    const auto station = modbus::parse_endpoint(config->modbus);
    if (!station) return complain(station.error(), kBadConfiguration);
    auto tokens = config->tokens.empty() ? Result<Tokens>(Tokens{}) : Tokens::load(config->tokens);
    if (!tokens) return complain(tokens.error(), kBadConfiguration);
    if (options.check) {
        std::error_code none;
        if (std::filesystem::exists(config->store, none) && !std::filesystem::is_directory(config->store, none))
            return complain({hord::ErrorCode::unreadable, config->store.string() + " is no folder of a store",
                             "name the folder that holds results.db (--store, or [station] store)"},
                            kBadConfiguration);
        const bool there = std::filesystem::exists(options.config);
        fmt::print("{} {}\n", options.config, there ? "can be used" : "does not exist: the defaults are used");
        return 0;
    }
    return serve(*config, *tokens, *station);
}
