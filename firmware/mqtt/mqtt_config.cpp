#include "firmware/mqtt/mqtt_config.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <optional>
#include <utility>

#include <sys/stat.h>
#include <unistd.h>

#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/regular_file.h"
#include "common/toml_fields.h"

namespace hord::firmware::mqtt {
namespace {

using common::TomlProblems;
using common::TomlTable;

std::string host_name() {
    std::array<char, 256> name{};
    return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "station";
}

// One level of a topic: no separator, no wildcard.
bool can_be_in_topic(const std::string& name) {
    const auto forbidden = [](unsigned char c) { return c == '/' || c == '+' || c == '#' || c < 0x20 || c == 0x7F; };
    return !name.empty() && name.size() <= 100 && std::ranges::none_of(name, forbidden);
}

bool is_this_machine(const std::string& host) {
    return host == "localhost" || host == "::1" || host.starts_with("127.");
}

void read_path(TomlTable& table, std::string_view key, std::filesystem::path& path) {
    std::string text = path.string();
    table.text(key, text);
    path = text;
}

void read_broker(TomlTable table, MqttConfig& config, std::optional<std::uint16_t>& port) {
    table.text("host", config.broker.host);
    if (config.broker.host.empty()) table.problem("host", "is empty", "name the broker's host");
    if (table.has("port")) {
        std::uint16_t given = 1883;
        table.integer("port", given, 1, 65535);
        port = given;
    }
    static constexpr std::array<std::string_view, 2> kProtocols{"5", "3.1.1"};
    if (const auto chosen = table.choice("protocol", kProtocols)) config.broker.protocol = *chosen == 0 ? 5 : 4;
    table.integer("keepalive_s", config.broker.keepalive_s, 5, 3600);
    table.text("client_id", config.broker.client_id);
    table.text("user", config.broker.user);
    read_path(table, "password_file", config.password_file);
    if (!config.password_file.empty() && config.broker.user.empty())
        table.problem("password_file", "is given without a user", "give broker.user, too");
}

void read_tls(TomlTable table, MqttConfig& config) {
    BrokerOptions& broker = config.broker;
    read_path(table, "ca", broker.ca);
    read_path(table, "certificate", broker.certificate);
    read_path(table, "key", broker.key);
    if (broker.certificate.empty() != broker.key.empty())
        table.problem(broker.certificate.empty() ? "key" : "certificate", "needs the other of the two",
                      "give tls.certificate and tls.key");
    if (broker.ca.empty() && !broker.certificate.empty())
        table.problem("certificate", "is given without an authority",
                      "give tls.ca: the file that the broker's certificate is checked with");
}

// A pipe in the place of one would stop the start for ever, also in the library that reads certificates.
Result<void> check_regular_files(const MqttConfig& config) {
    TomlProblems found;
    for (const auto& [key, file] :
         {std::pair("broker.password_file", config.password_file), std::pair("tls.ca", config.broker.ca),
          std::pair("tls.certificate", config.broker.certificate), std::pair("tls.key", config.broker.key),
          std::pair("results.state_file", config.state_file)}) {
        auto fine = common::check_regular(file, "name a regular file");
        if (fine) continue;
        fine.error().what.insert(0, std::string(key) + ": ");
        found.add(fine.error());
    }
    return found.empty() ? Result<void>() : found.as_error();
}

}  // namespace

Result<MqttConfig> parse_mqtt_config(std::string_view text, std::string_view name,
                                     const std::filesystem::path& folder) {
    TomlProblems problems;
    TomlTable root = TomlTable::parse_text(text, name, problems);
    MqttConfig config;
    std::optional<std::uint16_t> port;

    TomlTable broker = root.table("broker");
    read_broker(broker, config, port);
    read_tls(root.table("tls"), config);
    config.broker.port = port.value_or(config.broker.ca.empty() ? 1883 : 8883);
    if (!config.password_file.empty() && config.broker.ca.empty() && !is_this_machine(config.broker.host)) {
        broker.problem("password_file", "would be sent readable for everybody on the way",
                       "give tls.ca, so that the connection is encrypted");
    }

    TomlTable sparkplug = root.table("sparkplug");
    config.node.node = host_name();
    sparkplug.text("group", config.node.group);
    sparkplug.text("node", config.node.node);
    sparkplug.text("primary_host", config.node.primary_host);
    for (const auto& [key, level] : {std::pair("group", &config.node.group), std::pair("node", &config.node.node),
                                     std::pair("primary_host", &config.node.primary_host)}) {
        if (!can_be_in_topic(*level) && !(level == &config.node.primary_host && level->empty()))
            sparkplug.problem(key, "cannot be part of a topic", "use 1 to 100 characters, none of / + #");
    }
    if (config.broker.client_id.empty()) config.broker.client_id = "hord-" + config.node.group + "-" + config.node.node;

    TomlTable results = root.table("results");
    read_path(results, "store", config.store);
    read_path(results, "state_file", config.state_file);
    results.integer("qos", config.node.qos, 0, 1);
    results.integer("in_flight", config.node.in_flight, 1, 1000);
    results.integer("repeat", config.node.repeat, 0, 100'000);
    results.integer("history_per_s", config.node.history_per_s, 0, 100'000);
    static constexpr std::array<std::string_view, 2> kBegins{"new", "all"};
    if (const auto chosen = results.choice("begin", kBegins)) config.node.begin_with_all = *chosen == 1;

    TomlTable station = root.table("station");
    std::string address = "127.0.0.1:502";
    station.text("modbus", address);
    if (const auto endpoint = modbus::parse_endpoint(address)) config.station = *endpoint;
    else station.problem("modbus", endpoint.error().what, endpoint.error().cure);
    std::int64_t every_ms = config.look_every.count();
    station.integer("every_ms", every_ms, 100, 3'600'000);
    config.look_every = std::chrono::milliseconds(every_ms);

    root.refuse_unknown_keys();
    if (!problems.empty()) return problems.as_error();
    for (std::filesystem::path* path : {&config.password_file, &config.broker.ca, &config.broker.certificate,
                                        &config.broker.key, &config.store, &config.state_file}) {
        if (!path->empty() && path->is_relative()) *path = folder / *path;
    }
    return config;
}

Result<MqttConfig> load_mqtt_config(const std::filesystem::path& file) {
    const auto text = common::read_file(file);
    if (!text)
        return fail(ErrorCode::invalid_argument, file.string() + " cannot be read (" + std::strerror(errno) + ")",
                    "name the configuration: --config FILE");
    if (auto fine = common::refuse_blank(*text, file); !fine) return tl::unexpected(fine.error());
    if (auto right = common::require_kind(*text, file.string(), common::FileKind::mqtt); !right)
        return tl::unexpected(right.error());
    return parse_mqtt_config(*text, file.string(), file.parent_path()).and_then([](MqttConfig config) {
        return check_regular_files(config).map([&] { return std::move(config); });
    });
}

std::filesystem::path credential_or(const std::filesystem::path& file) {
    const char* folder = std::getenv("CREDENTIALS_DIRECTORY");
    if (folder == nullptr || file.empty()) return file;
    const auto credential = std::filesystem::path(folder) / file.filename();
    std::ifstream in(credential);
    std::string first;
    return std::getline(in, first) && first != "-" ? credential
                                                   : file;  // "-": the original does not exist (hord-mqtt.service)
}

Result<std::string> read_secret(const std::filesystem::path& named) {
    const auto file = credential_or(named);
    if (auto regular = common::check_regular(file, "write the password into a regular file"); !regular)
        return tl::unexpected(regular.error());
    struct stat about {};
    std::ifstream in(file);
    if (!in || ::stat(file.c_str(), &about) != 0) {
        return fail(ErrorCode::not_found, file.string() + " cannot be read (" + std::strerror(errno) + ")",
                    "write the password into it, for root alone; the service gets it by LoadCredential=");
    }
    if (file == named && (about.st_mode & 077U) != 0)
        return fail(ErrorCode::refused, file.string() + " may be read by others", "chmod 600 it");
    std::string line;
    std::getline(in, line);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty())
        return fail(ErrorCode::not_found, file.string() + " holds no password",
                    "write the password into its first line");
    return line;
}

}  // namespace hord::firmware::mqtt
