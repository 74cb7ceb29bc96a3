// hord-mqtt: publishes a station's results and state to an MQTT broker, as a Sparkplug B edge node. A process of its
// own beside hordd: it only reads registers and store.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/cli/program.h"
#include "common/service_manager.h"
#include "common/toml_fields.h"
#include "firmware/mqtt/agent.h"
#include "firmware/mqtt/mqtt_config.h"

namespace {

using namespace hord;
using namespace hord::firmware;
using namespace hord::firmware::mqtt;

constexpr int kBadConfiguration = 78;  // EX_CONFIG: starting again does not help
constexpr int kCannotRun = 2;
constexpr std::chrono::milliseconds kModbusAnswer(1000), kPause(50);

volatile std::sig_atomic_t asked_to_stop = 0;

void say(const std::string& line) { print_message("hord-mqtt: {}\n", line); }

int complain(const Error& error, int status) {
    say(error.message());
    common::tell_manager("STATUS=" + error.message());
    return status;
}

// The station's registers, read anew by every look(). A station that does not answer is reported once.
class Station {
  public:
    explicit Station(modbus::Endpoint endpoint) : endpoint_(std::move(endpoint)) {}

    std::vector<Reading> look() {
        auto all = read();
        if (all) {
            silent_ = false;
            return std::move(*all);
        }
        client_.reset();
        if (!std::exchange(silent_, true)) say(all.error().message());
        return {};
    }

  private:
    Result<std::vector<Reading>> read() {
        if (!client_) {
            auto connected = modbus::Client::connect(endpoint_, kModbusAnswer);
            if (!connected) return tl::unexpected(connected.error());
            client_.emplace(std::move(*connected));
        }
        std::vector<Reading> all;
        for (const BlockId id : published_blocks()) {
            const auto readings = client_->read_block(id);
            if (readings) all.insert(all.end(), readings->begin(), readings->end());
            else if (readings.error().code != ErrorCode::not_found) return tl::unexpected(readings.error());
        }
        return all;
    }
    modbus::Endpoint endpoint_;
    std::optional<modbus::Client> client_;
    bool silent_ = false;
};

// Completes the configuration from the environment: folder of the state file, password, credentials.
Result<MqttConfig> complete(MqttConfig config) {
    if (config.state_file.empty()) {
        const char* folder = std::getenv("STATE_DIRECTORY");
        if (folder == nullptr || *folder == '\0') {
            return fail(ErrorCode::invalid_argument, "there is no place for the state file",
                        "set results.state_file, or run it as the service, which has $STATE_DIRECTORY");
        }
        config.state_file = std::filesystem::path(folder) / "cursor";
    }
    config.broker.key = credential_or(config.broker.key);
    if (!config.password_file.empty()) {
        auto password = read_secret(config.password_file);
        if (!password) return tl::unexpected(password.error());
        config.broker.password = std::move(*password);
    }
    return config;
}

int serve(const MqttConfig& config) {
    Station station(config.station);
    auto agent = Agent::open(
        config, std::make_unique<ResultFeed>(config.store), [&] { return station.look(); }, say);
    if (!agent) return complain(agent.error(), kCannotRun);
    common::tell_manager("READY=1");
    std::string told;
    while (asked_to_stop == 0) {
        (*agent)->step(kPause);
        if (!(*agent)->node().born() && !(*agent)->node().waits_for_host()) {
            const timespec pause{0, std::chrono::nanoseconds(kPause).count()};
            ::nanosleep(&pause, nullptr);  // cut short by a signal
        }
        const std::string status = (*agent)->status();
        if (status != told) common::tell_manager("STATUS=" + status);
        else common::tell_manager_again();
        told = status;
    }
    common::tell_manager("STOPPING=1");
    (*agent)->close();
    say("stopped as asked; " + (*agent)->status());
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    std::string file = "/etc/hord/mqtt.toml";
    bool check = false;
    CLI::App program{
        "hord-mqtt: hands a station's results and health to an MQTT broker (Sparkplug B); runs until SIGTERM"};
    program.set_version_flag("--version", "hord-mqtt " HORD_VERSION);
    program.add_option("--config", file, "Configuration (TOML)")->capture_default_str();
    program.add_flag("--check", check, "Only read the configuration and say what is wrong with it");
    program.footer(
        "Exit status: 0 stopped as asked, 2 usage, or its state file cannot be used, 78 the configuration cannot be "
        "used.\n"
        "Example: hord-mqtt --config deploy/mqtt.toml --check");
    if (const auto ended = hord::parse_command_line(program, argc, argv)) return *ended;
    never_wait_for_stderr();
    auto config = load_mqtt_config(file);
    if (!config) return complain(config.error(), kBadConfiguration);
    if (const auto cut = common::may_have_lost_its_end(file)) say(cut->message());
    if (check) {
        fmt::print("{} can be used\n", file);
        return 0;
    }
    config->node.software = HORD_VERSION;
    config = complete(std::move(*config));
    if (!config) return complain(config.error(), kBadConfiguration);
    struct sigaction stop {};
    stop.sa_handler = [](int) { asked_to_stop = 1; };
    ::sigaction(SIGTERM, &stop, nullptr);
    ::sigaction(SIGINT, &stop, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
    return serve(*config);
}
