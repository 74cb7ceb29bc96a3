// Access rules of the register server: who may connect, who may write.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "common/result.h"

struct sockaddr;

namespace hord::firmware::modbus {

// A network as in the configuration: "192.0.2.0/24", "2001:db8::/32", or one address. IPv4 is stored as
// ::ffff:a.b.c.d.
struct Network {
    std::array<std::uint8_t, 16> address{};
    int prefix_bits = 128;  // of the 128
};

// Fails with invalid_argument: not an address, a prefix too long, or bits set beyond it.
[[nodiscard]] Result<Network> parse_network(std::string_view text);

struct AccessRule {
    Network network;
    bool may_write = false;
};

enum class Access : std::uint8_t { none, read, read_write };

// The first rule whose network contains the peer decides; without one: none. An empty list: read_write.
[[nodiscard]] Access access_of(const sockaddr& peer, std::span<const AccessRule> rules);

}  // namespace hord::firmware::modbus
