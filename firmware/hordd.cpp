// hordd: the station as a service. Everything it does it does through Service; this file only speaks to systemd.
#include <cstdio>
#include <cstring>
#include <string>

#include <fmt/format.h>
#include <systemd/sd-daemon.h>

#include "firmware/service.h"

namespace {

using namespace hord;
using namespace hord::firmware;

constexpr const char* kDefaultConfig = "/etc/hord/hordd.toml";
constexpr const char* kHelp =
    "usage: hordd [--config FILE]\n"
    "\n"
    "Runs the inspection station until SIGTERM. FILE is /etc/hord/hordd.toml unless given.\n"
    "Exit status: 0 stopped as asked, 2 the configuration, a device or a port cannot be used (one line on stderr says which).\n"
    "\n"
    "Example: hordd --config deploy/hordd.toml\n";

// The level prefix of sd-daemon(3): journald reads it, a terminal shows it.
int complain(const Error& error) {
    fmt::print(stderr, SD_ERR "hordd: {}\n", error.message());
    return 2;
}

}  // namespace

int main(int argc, char** argv) {
    std::string file = kDefaultConfig;
    if (argc == 2 && std::strcmp(argv[1], "--help") == 0) {
        std::fputs(kHelp, stdout);
        return 0;
    }
    if (argc == 3 && std::strcmp(argv[1], "--config") == 0) {
        file = argv[2];
    } else if (argc != 1) {
        std::fputs(kHelp, stderr);
        return 2;
    }
    const auto config = load_config(file);
    if (!config) return complain(config.error());

    ServiceWatchers watchers;
    watchers.state = [](State from, State to) {
        fmt::print(stderr, SD_NOTICE "hordd: {} to {}\n", name_of(from), name_of(to));
        sd_notifyf(0, "STATUS=%.*s", static_cast<int>(name_of(to).size()), name_of(to).data());
    };
    watchers.trouble = [](const Error& error) { fmt::print(stderr, SD_WARNING "hordd: {}\n", error.message()); };
    auto service = Service::open(*config, {}, std::move(watchers));
    if (!service) return complain(service.error());
    fmt::print(stderr, SD_INFO "hordd: registers at {}\n", (*service)->registers_address());
    sd_notify(0, "READY=1");
    const auto ran = (*service)->run();
    sd_notify(0, "STOPPING=1");
    return ran ? 0 : complain(ran.error());
}
