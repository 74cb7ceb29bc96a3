// The configuration of hord-mqtt: one TOML file, deploy/mqtt.toml documents every key.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <string_view>

#include "common/result.h"
#include "firmware/mqtt/broker_link.h"
#include "firmware/mqtt/edge_node.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware::mqtt {

struct MqttConfig {
    BrokerOptions broker;
    NodeOptions node;
    std::filesystem::path password_file;
    std::filesystem::path store = "/var/lib/hord/store";
    std::filesystem::path state_file;  // empty: "cursor" in the service's $STATE_DIRECTORY
    modbus::Endpoint station{"127.0.0.1", 502};
    std::chrono::milliseconds look_every{1000};
};

// Fails with invalid_argument; every problem of the file at once, a line each with line number and cure. Relative paths
// inside are taken from the file's folder.
Result<MqttConfig> load_mqtt_config(const std::filesystem::path& file);
Result<MqttConfig> parse_mqtt_config(std::string_view text, std::string_view name, const std::filesystem::path& folder);

// The first line of a file that only its owner may read. A file of that name among the service's credentials
// ($CREDENTIALS_DIRECTORY, systemd's LoadCredential=) has precedence: then only root needs to read the original. Fails
// with not_found, refused (others may read it).
Result<std::string> read_secret(const std::filesystem::path& file);

// The path of that name among the service's credentials if there is one, else `file`.
std::filesystem::path credential_or(const std::filesystem::path& file);

}  // namespace hord::firmware::mqtt
