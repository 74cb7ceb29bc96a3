#include "firmware/modbus/access.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

namespace hord::firmware::modbus {
namespace {

sockaddr_in6 peer_of(const char* address) {
    sockaddr_in6 peer{};
    auto& v4 = reinterpret_cast<sockaddr_in&>(peer);
    if (::inet_pton(AF_INET, address, &v4.sin_addr) == 1) {
        v4.sin_family = AF_INET;
    } else {
        EXPECT_EQ(::inet_pton(AF_INET6, address, &peer.sin6_addr), 1) << address;
        peer.sin6_family = AF_INET6;
    }
    return peer;
}
Access access_of(const char* address, std::span<const AccessRule> rules) {
    const sockaddr_in6 peer = peer_of(address);
    return modbus::access_of(reinterpret_cast<const sockaddr&>(peer), rules);
}

TEST(Access, the_first_rule_that_holds_the_peer_decides) {
    const AccessRule rules[] = {{*parse_network("192.0.2.7"), true},
                                {*parse_network("192.0.2.0/24"), false},
                                {*parse_network("2001:db8::/32"), true}};
    EXPECT_EQ(access_of("192.0.2.7", rules), Access::read_write);
    EXPECT_EQ(access_of("192.0.2.8", rules), Access::read);
    EXPECT_EQ(access_of("192.0.3.7", rules), Access::none);
    EXPECT_EQ(access_of("::ffff:192.0.2.7", rules), Access::read_write) << "IPv4 that comes through an IPv6 listener";
    EXPECT_EQ(access_of("2001:db8:1::1", rules), Access::read_write);
    EXPECT_EQ(access_of("2001:db9::1", rules), Access::none);
}

TEST(Access, without_rules_everybody_may_write) { EXPECT_EQ(access_of("198.51.100.1", {}), Access::read_write); }

TEST(Access, a_prefix_of_zero_holds_everybody_of_its_kind) {
    const AccessRule v4[] = {{*parse_network("0.0.0.0/0"), false}};
    EXPECT_EQ(access_of("198.51.100.1", v4), Access::read);
    EXPECT_EQ(access_of("2001:db8::1", v4), Access::none);
    const AccessRule all[] = {{*parse_network("::/0"), false}};
    EXPECT_EQ(access_of("198.51.100.1", all), Access::read);
}

TEST(Access, what_is_no_network_is_refused_with_a_cure) {
    for (const char* text : {"", "plc", "192.0.2", "192.0.2.0/", "192.0.2.0/33", "192.0.2.0/-1", "192.0.2.0/2x",
                             "192.0.2.1/24", "2001:db8::/129", "2001:db8::1/32"}) {
        const auto network = parse_network(text);
        ASSERT_FALSE(network) << text;
        EXPECT_FALSE(network.error().cure.empty());
    }
}

}  // namespace
}  // namespace hord::firmware::modbus
