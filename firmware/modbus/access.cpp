#include "firmware/modbus/access.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <optional>
#include <string>

#include <arpa/inet.h>
#include <netinet/in.h>

namespace hord::firmware::modbus {
namespace {

using Address = std::array<std::uint8_t, 16>;

Address mapped(const in_addr& v4) {
    Address address{};
    address[10] = address[11] = 0xFF;
    std::memcpy(address.data() + 12, &v4, 4);
    return address;
}

bool bit_of(const Address& address, int bit) {
    return (address[static_cast<std::size_t>(bit / 8)] >> (7 - bit % 8) & 1) != 0;
}

bool holds(const Network& network, const Address& address) {
    for (int bit = 0; bit < network.prefix_bits; ++bit) {
        if (bit_of(network.address, bit) != bit_of(address, bit)) return false;
    }
    return true;
}

}  // namespace

Result<Network> parse_network(std::string_view text) {
    const auto wrong = [&](const char* cure) {
        return fail(ErrorCode::invalid_argument, "\"" + std::string(text) + "\" is not a network", cure);
    };
    const auto slash = text.find('/');
    const std::string host(text.substr(0, slash));
    Network network;
    in_addr v4{};
    const bool is_v4 = ::inet_pton(AF_INET, host.c_str(), &v4) == 1;
    if (is_v4) {
        network.address = mapped(v4);
    } else if (::inet_pton(AF_INET6, host.c_str(), network.address.data()) != 1) {
        return wrong("write an address, or a network such as 192.0.2.0/24");
    }
    if (slash != std::string_view::npos) {
        const std::string_view bits = text.substr(slash + 1);
        int prefix = -1;
        const auto [end, error] = std::from_chars(bits.data(), bits.data() + bits.size(), prefix);
        if (error != std::errc{} || end != bits.data() + bits.size() || prefix < 0 || prefix > (is_v4 ? 32 : 128)) {
            return wrong("write the number of leading bits after the slash, 0 to 32 (IPv6: 128)");
        }
        network.prefix_bits = is_v4 ? 96 + prefix : prefix;
    }
    for (int bit = network.prefix_bits; bit < 128; ++bit) {
        if (bit_of(network.address, bit)) return wrong("clear the bits behind the prefix, as in 192.0.2.0/24");
    }
    return network;
}

Access access_of(const sockaddr& peer, std::span<const AccessRule> rules) {
    if (rules.empty()) return Access::read_write;
    Address address{};
    if (peer.sa_family == AF_INET) {
        address = mapped(reinterpret_cast<const sockaddr_in&>(peer).sin_addr);
    } else if (peer.sa_family == AF_INET6) {
        std::memcpy(address.data(), &reinterpret_cast<const sockaddr_in6&>(peer).sin6_addr, address.size());
    } else {
        return Access::none;
    }
    const auto rule =
        std::find_if(rules.begin(), rules.end(), [&](const AccessRule& r) { return holds(r.network, address); });
    if (rule == rules.end()) return Access::none;
    return rule->may_write ? Access::read_write : Access::read;
}

}  // namespace hord::firmware::modbus
