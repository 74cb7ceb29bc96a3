// A misbehaving client must not disturb a legitimate one that polls: none of its requests may fail, and its connection
// must stay open.
#include <random>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "tests/firmware/modbus/modbus_peer.h"

namespace hord::firmware::modbus {
namespace {

constexpr int kPolls = 200;

class Attack : public ServedStation {
  protected:
    std::unique_ptr<Client> legitimate;

    void SetUp() override {
        rlimit files{};
        ::getrlimit(RLIMIT_NOFILE, &files);
        files.rlim_cur = std::min<rlim_t>(files.rlim_max, 8192);
        ::setrlimit(RLIMIT_NOFILE, &files);
        ServedStation::SetUp();
        legitimate = std::make_unique<Client>(client());
        poll(kPolls);
    }
    // No reconnect and no retry here: either would hide an eviction.
    void poll(int times) {
        for (int k = 0; k < times; ++k) {
            const auto words = legitimate->read(0, 100);
            ASSERT_TRUE(words) << words.error().message();
            ASSERT_EQ(words->at(2), 0x484F);
        }
    }
    // A client that connects during the attack is served, too. (Not with libmodbus: it aborts at descriptor 1024.)
    void newcomer_is_served() {
        Peer other(port);
        other.send(kReadMagic);
        EXPECT_EQ(other.receive(13), kMagicReply);
    }
};

TEST_F(Attack, partial_frames_held_for_ever) {
    std::vector<Peer> peers;
    for (std::size_t k = 0; k < 31; ++k) {
        peers.emplace_back(port).send(
            Bytes(kReadMagic.begin(), kReadMagic.begin() + static_cast<std::ptrdiff_t>(1 + k % 11)));
    }
    poll(kPolls);
    newcomer_is_served();
    poll(kPolls);
}

TEST_F(Attack, one_byte_at_a_time) {
    Peer slow(port);
    for (int k = 0; k < 40; ++k) {
        for (const std::uint8_t byte : kReadMagic) {
            slow.send({byte});
            poll(1);
        }
        EXPECT_EQ(slow.receive(13), kMagicReply);
    }
}

TEST_F(Attack, a_client_that_never_reads_its_replies) {
    std::vector<Peer> peers;
    for (int k = 0; k < 8; ++k) {
        Peer& peer = peers.emplace_back(port, 4096);
        const Bytes request{0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 125};
        Bytes many;
        for (int n = 0; n < 1000; ++n) many.insert(many.end(), request.begin(), request.end());
        int pieces = 0;
        while (peer.send(many) == many.size() && ++pieces < 2000) loop.on_loop([] {});
        ASSERT_LT(pieces, 2000) << "the server goes on reading requests whose replies nobody takes";
    }
    poll(kPolls);
    newcomer_is_served();
    // The loop must not spin on waiting connections: a poll costs a turn or two.
    const auto before = loop.turns();
    poll(kPolls);
    EXPECT_LT(loop.turns() - before, 10U * kPolls);
}

TEST_F(Attack, a_client_that_never_reads_gets_its_replies_when_it_does) {
    Peer lazy(port, 4096);
    const Bytes request{0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 100};
    std::size_t sent = 0;
    Bytes many;
    for (int n = 0; n < 100; ++n) many.insert(many.end(), request.begin(), request.end());
    for (std::size_t now = many.size(); now == many.size() && sent < 50'000'000; sent += now) {
        now = lazy.send(many);
        loop.on_loop([] {});
    }
    const std::size_t replies = sent / request.size();
    EXPECT_EQ(lazy.receive(replies * 209).size(), replies * 209);
}

TEST_F(Attack, garbage) {
    std::mt19937 random(1);
    for (int k = 0; k < 200; ++k) {
        Peer peer(port);
        Bytes noise(64 + random() % 2000);
        for (auto& byte : noise) byte = static_cast<std::uint8_t>(random());
        noise[2] = 1;  // a protocol that is not Modbus
        peer.send(noise);
        EXPECT_TRUE(peer.closed_by_server());
        poll(1);
    }
    EXPECT_EQ(statistics().broken, 200U);
    EXPECT_EQ(statistics().connections, 1U);
}

TEST_F(Attack, oversized_frames_and_surplus_bytes) {
    for (int k = 0; k < 50; ++k) {
        Peer oversized(port), surplus(port);
        oversized.send({0, 1, 0, 0, 0xFF, 0xFF, 1, 3, 0, 0});
        EXPECT_TRUE(oversized.closed_by_server());
        Bytes bytes = kReadMagic;
        bytes.insert(bytes.end(), {1, 2, 3, 4, 5});  // the surplus bytes shift the next request
        bytes.insert(bytes.end(), kReadMagic.begin(), kReadMagic.end());
        surplus.send(bytes);
        EXPECT_LE(surplus.receive(14).size(), 13U) << "answered once at most, then closed";
        poll(2);
    }
}

TEST_F(Attack, bad_functions_and_quantities) {
    Peer peer(port);
    for (int k = 0; k < 500; ++k) {
        peer.send({0, 1, 0, 0, 0, 6, 1, static_cast<std::uint8_t>(64 + k % 60), 0, 0, 0, 1});
        EXPECT_EQ(peer.receive(9)[8], 1);
        peer.send({0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0xFF, 0xFF});
        EXPECT_EQ(peer.receive(9)[8], 3);
        poll(1);
    }
    EXPECT_GE(statistics().exceptions, 1000U);
}

TEST_F(Attack, a_client_that_asks_without_a_pause) {
    std::atomic<bool> stop = false;
    std::thread greedy([&] {
        Peer peer(port);
        Bytes many;
        for (int k = 0; k < 20; ++k) many.insert(many.end(), kReadMagic.begin(), kReadMagic.end());
        while (!stop) {
            peer.send(many);
            peer.receive(20 * 13);
        }
    });
    poll(5 * kPolls);
    newcomer_is_served();
    stop = true;
    greedy.join();
}

TEST_F(Attack, fifteen_hundred_connections_that_say_nothing) {
    std::vector<Peer> peers;
    for (int k = 0; k < 1500; ++k) {
        peers.emplace_back(port);
        ASSERT_TRUE(peers.back().connected()) << k;
        if (k % 50 == 0) poll(1);
    }
    poll(kPolls);
    newcomer_is_served();
    EXPECT_LE(statistics().connections, 32U);
    EXPECT_GE(statistics().evicted, 1400U);
}

TEST_F(Attack, fifteen_hundred_connections_that_ask_once) {
    std::vector<Peer> peers;
    for (int k = 0; k < 1500; ++k) {
        Peer& peer = peers.emplace_back(port);
        peer.send(kReadMagic);
        ASSERT_EQ(peer.receive(13), kMagicReply) << "every newcomer is answered";
        if (k % 50 == 0) poll(1);
    }
    poll(kPolls);
    newcomer_is_served();
}

TEST_F(Attack, connections_that_come_and_go) {
    for (int k = 0; k < 1000; ++k) {
        Peer peer(port);
        if (k % 3 != 0) peer.send(Bytes(kReadMagic.begin(), kReadMagic.begin() + k % 12));
        if (k % 10 == 0) poll(1);
    }
    poll(kPolls);
}

TEST_F(Attack, a_regular_client_makes_room_only_when_all_are_regular) {
    loop.on_loop([&] { server.reset(); });
    serve({.max_connections = 3});
    std::vector<Client> regulars;
    for (int k = 0; k < 3; ++k) {
        regulars.push_back(client());
        for (int n = 0; n < 20; ++n) ASSERT_TRUE(regulars.back().read(0, 2));
    }
    ASSERT_TRUE(regulars[0].read(0, 2));  // now the second is the least recently used
    Client fourth = client();
    ASSERT_TRUE(fourth.read(0, 2));
    EXPECT_TRUE(regulars[0].read(0, 2));
    EXPECT_TRUE(regulars[2].read(0, 2));
    EXPECT_FALSE(regulars[1].read(0, 2)) << "evicted";
    EXPECT_EQ(statistics().evicted, 1U);
    EXPECT_TRUE(regulars[1].read(0, 2)) << "and back: the fourth, a newcomer, makes room";
    EXPECT_EQ(statistics().evicted, 2U);
}

// Its connections outnumber those of the PLC and ask more often.
TEST_F(Attack, one_address_with_many_patient_connections_evicts_its_own) {
    Peer plc(port, 0, 2);
    for (int k = 0; k < 8; ++k) ASSERT_TRUE(plc.asks());
    std::vector<Peer> patient;
    for (int k = 0; k < 64; ++k) {
        Peer& peer = patient.emplace_back(port, 0, 3);
        for (int n = 0; n < 10; ++n) ASSERT_TRUE(peer.asks());
        poll(1);
    }
    EXPECT_GE(statistics().evicted, 34U);
    EXPECT_TRUE(plc.asks());
    Peer scanner(port, 0, 4);  // an address that holds few connections gets one, too
    EXPECT_TRUE(scanner.asks());
    EXPECT_TRUE(plc.asks());
}

TEST_F(Attack, a_client_that_writes_stays_for_others_that_read) {
    struct Writable : RegisterModel {
        Exception read_registers(std::uint16_t, std::span<std::uint16_t> out) override {
            std::ranges::copy(std::array<std::uint16_t, 2>{0x484F, 0x5244}, out.begin());
            return Exception::none;
        }
        Exception write_registers(const Origin&, std::uint16_t, std::span<const std::uint16_t>) override {
            return Exception::none;
        }
    } model;
    loop.on_loop([&] { server.reset(); });
    server = *loop.on_loop([&] { return Server::open(loop, model, {.host = "127.0.0.1", .port = 0}); });
    port = server->port();
    Peer plc(port, 0, 2);
    const Bytes heartbeat{0, 1, 0, 0, 0, 6, 1, 6, 0x1F, 0xA4, 0, 1};
    plc.send(heartbeat);
    ASSERT_EQ(plc.receive(heartbeat.size()), heartbeat);
    std::vector<Peer> patient;
    for (std::uint8_t k = 0; k < 64; ++k) {
        Peer& peer = patient.emplace_back(port, 0, static_cast<std::uint8_t>(10 + k));
        for (int n = 0; n < 10; ++n) ASSERT_TRUE(peer.asks());
    }
    EXPECT_TRUE(plc.asks());
    loop.on_loop([&] { server.reset(); });  // before its model
}

TEST_F(Attack, a_reader_is_refused_where_all_others_may_write) {
    loop.on_loop([&] { server.reset(); });
    serve({.max_connections = 3,
           .access = {{*parse_network("127.0.0.1"), true}, {*parse_network("127.0.0.0/8"), false}}});
    Peer first(port), second(port), third(port);
    for (Peer* writer : {&first, &second, &third}) ASSERT_TRUE(writer->asks());
    Peer reader(port, 0, 9);
    EXPECT_TRUE(reader.closed_by_server());
    for (Peer* writer : {&first, &second, &third}) EXPECT_TRUE(writer->asks());
    EXPECT_EQ(statistics().refused, 1U);
    Peer fourth(port);
    EXPECT_TRUE(fourth.asks());
    EXPECT_EQ(statistics().evicted, 1U);
}

// A forked child keeps the socket open: closing it alone would leave it in the epoll, with a pointer to nothing.
TEST_F(Attack, a_closed_connection_is_not_watched_any_more_while_a_child_holds_it) {
    Peer broken(port);
    ASSERT_TRUE(broken.asks());
    int ends[2];
    ASSERT_EQ(::pipe(ends), 0);
    const pid_t child = ::fork();
    if (child == 0) {
        ::close(ends[1]);
        char byte = 0;
        ::_exit(static_cast<int>(::read(ends[0], &byte, 1)));
    }
    broken.send({0, 1, 0, 9, 0, 6, 1, 3, 0, 0, 0, 1});
    while (statistics().broken == 0) std::this_thread::yield();
    broken.send(kReadMagic);
    const auto before = loop.turns();
    poll(kPolls);
    EXPECT_LT(loop.turns() - before, 10U * kPolls);
    ::close(ends[0]);
    ::close(ends[1]);
    int status = 0;
    EXPECT_EQ(::waitpid(child, &status, 0), child);
}

TEST_F(Attack, without_descriptors_a_connection_makes_room_for_the_next) {
    const int fresh = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    rlimit files{};
    ::getrlimit(RLIMIT_NOFILE, &files);
    const rlimit before = files;
    files.rlim_cur = 256;
    ::setrlimit(RLIMIT_NOFILE, &files);
    std::vector<int> hoard;
    for (int fd = ::dup(0); fd >= 0; fd = ::dup(0)) hoard.push_back(fd);
    ASSERT_FALSE(hoard.empty());

    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(::connect(fresh, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    ASSERT_EQ(::send(fresh, kReadMagic.data(), kReadMagic.size(), 0), static_cast<ssize_t>(kReadMagic.size()));
    Bytes reply(13);
    EXPECT_EQ(::recv(fresh, reply.data(), reply.size(), MSG_WAITALL), 13);
    EXPECT_EQ(reply, kMagicReply);

    for (const int fd : hoard) ::close(fd);
    ::setrlimit(RLIMIT_NOFILE, &before);
    ::close(fresh);
    newcomer_is_served();
}

TEST_F(Attack, all_of_them_together) {
    std::vector<Peer> held;
    for (int k = 0; k < 20; ++k) held.emplace_back(port).send({0, 1, 0});
    std::atomic<bool> stop = false;
    std::vector<std::thread> attackers;
    for (std::uint32_t seed = 0; seed < 3; ++seed) {
        attackers.emplace_back([&, seed] {
            std::mt19937 random(seed);
            while (!stop) {
                Peer peer(port, 4096);
                Bytes bytes(1 + random() % 400);
                for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() % 8);
                if (random() % 2 == 0) bytes = kReadMagic;
                for (auto n = random() % 20; n > 0; --n) peer.send(bytes);
            }
        });
    }
    poll(5 * kPolls);
    stop = true;
    for (auto& attacker : attackers) attacker.join();
    poll(kPolls);
    newcomer_is_served();
}

}  // namespace
}  // namespace hord::firmware::modbus
