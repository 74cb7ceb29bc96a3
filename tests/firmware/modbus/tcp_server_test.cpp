// The register server over real sockets: with literal bytes, with libmodbus, and with mbpoll.
#include "firmware/modbus/tcp_server.h"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/firmware/modbus/modbus_peer.h"

namespace hord::firmware::modbus {
namespace {

using ::testing::HasSubstr;

TEST_F(ServedStation, answers_a_frame_with_a_frame) {
    Peer peer(port);
    peer.send(kReadMagic);
    EXPECT_EQ(peer.receive(13), kMagicReply);
}

TEST_F(ServedStation, answers_requests_that_come_together_in_their_order) {
    Peer peer(port);
    Bytes many;
    for (int k = 0; k < 100; ++k) {
        Bytes request = kReadMagic;
        request[1] = static_cast<std::uint8_t>(k);
        many.insert(many.end(), request.begin(), request.end());
    }
    ASSERT_EQ(peer.send(many), many.size());
    for (int k = 0; k < 100; ++k) EXPECT_EQ(peer.receive(13)[1], k);
}

TEST_F(ServedStation, answers_a_request_that_comes_byte_by_byte) {
    Peer peer(port);
    for (const std::uint8_t byte : kReadMagic) {
        peer.send({byte});
        loop.on_loop([] {});
    }
    EXPECT_EQ(peer.receive(13), kMagicReply);
}

TEST_F(ServedStation, answers_before_it_closes_a_connection_that_turns_into_garbage) {
    Peer peer(port);
    Bytes stream = kReadMagic;
    stream.insert(stream.end(), {'G', 'E', 'T', ' ', '/', ' '});
    peer.send(stream);
    EXPECT_TRUE(peer.receive(14).size() <= 13);
    EXPECT_EQ(statistics().broken, 1U);
    EXPECT_EQ(statistics().connections, 0U);
}

TEST_F(ServedStation, libmodbus_walks_the_chain_and_reads_every_block_by_name) {
    Snapshot now;
    now.state = State::ready;
    now.counters.seen = 70'000;
    image.publish(now);
    Client reader = client();
    const auto places = reader.walk();
    ASSERT_TRUE(places) << places.error().message();
    ASSERT_GE(places->size(), 4U);
    EXPECT_EQ(places->at(1).base, 100);
    const auto status = reader.read_block(BlockId::status);
    ASSERT_TRUE(status) << status.error().message();
    EXPECT_EQ(status->at(0).text, "6 Ready");
    const auto counters = reader.read_block(BlockId::counters);
    ASSERT_TRUE(counters);
    EXPECT_EQ(counters->at(0).number, 70'000);
    const auto ident = reader.read_block(BlockId::ident);
    ASSERT_TRUE(ident);
    EXPECT_EQ(ident->back().text, "H-0042");
}

TEST_F(ServedStation, a_result_is_read_by_its_sequence) {
    Snapshot now;
    now.last.sequence = 300;
    now.last.latency_us = 1234;
    image.publish(now);
    Client reader = client();
    const auto result = reader.read_result(300);
    ASSERT_TRUE(result) << result.error().message();
    EXPECT_EQ(result->front().number, 300);
    const auto gone = reader.read_result(44);  // the same slot
    ASSERT_FALSE(gone);
    EXPECT_EQ(gone.error().code, ErrorCode::not_found);
}

TEST_F(ServedStation, an_exception_is_a_clear_error_and_the_connection_stays_good) {
    Client reader = client();
    const auto refused = reader.read(60000, 2);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::refused);
    EXPECT_THAT(refused.error().message(), HasSubstr("exception 02"));
    EXPECT_TRUE(reader.read(0, 125));
    EXPECT_EQ(statistics().accepted, 1U);
}

TEST_F(ServedStation, a_restarted_server_is_found_again_by_the_same_client) {
    Client reader = client();
    ASSERT_TRUE(reader.read(0, 2));
    const ServerOptions again{.host = "127.0.0.1", .port = port};
    loop.on_loop([&] { server.reset(); });
    EXPECT_FALSE(reader.read(0, 2));
    server = std::move(*loop.on_loop([&] { return Server::open(loop, image, again); }));
    EXPECT_TRUE(reader.read(0, 2));
}

TEST_F(ServedStation, who_is_not_on_the_list_is_closed_at_once) {
    loop.on_loop([&] { server.reset(); });
    serve({.access = {{*parse_network("192.0.2.0/24"), true}}});
    Peer peer(port);
    EXPECT_TRUE(peer.closed_by_server());
    EXPECT_EQ(statistics().refused, 1U);
    EXPECT_EQ(statistics().accepted, 0U);
}

TEST_F(ServedStation, who_may_only_read_knows_no_writing_function) {
    loop.on_loop([&] { server.reset(); });
    serve({.access = {{*parse_network("127.0.0.0/8"), false}}});
    Client reader = client();
    EXPECT_TRUE(reader.read(0, 2));
    const std::uint16_t one = 1;
    const auto written = reader.write(8102, std::span(&one, 1));
    ASSERT_FALSE(written);
    EXPECT_THAT(written.error().message(), HasSubstr("exception 01"));
}

// The server's end of the connection is a descriptor of this process.
TEST_F(ServedStation, a_dead_peer_is_noticed_within_a_minute_and_replies_do_not_wait_for_each_other) {
    Peer peer(port);
    ASSERT_TRUE(peer.asks());
    int ends = 0;
    for (int fd = 3; fd < 1024; ++fd) {
        sockaddr_in local{};
        socklen_t length = sizeof local;
        if (::getpeername(fd, reinterpret_cast<sockaddr*>(&local), &length) != 0 || local.sin_family != AF_INET)
            continue;
        length = sizeof local;
        ::getsockname(fd, reinterpret_cast<sockaddr*>(&local), &length);
        if (ntohs(local.sin_port) != port) continue;
        ++ends;
        const auto option = [&](int level, int name) {
            int value = 0;
            socklen_t size = sizeof value;
            EXPECT_EQ(::getsockopt(fd, level, name, &value, &size), 0);
            return value;
        };
        EXPECT_NE(option(SOL_SOCKET, SO_KEEPALIVE), 0);
        EXPECT_NE(option(IPPROTO_TCP, TCP_NODELAY), 0);
        EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPIDLE), 30);
        EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPINTVL) * option(IPPROTO_TCP, TCP_KEEPCNT), 30);
    }
    EXPECT_EQ(ends, 1);
}

// Exception 01: may not write; 02: may, and this model has nothing to write.
int refusal_of_a_write(Peer& peer) {
    peer.send({0, 1, 0, 0, 0, 6, 1, 6, 0x1F, 0xA6, 0, 1});
    const Bytes reply = peer.receive(9);
    return reply.size() == 9 ? reply[8] : 0;
}

TEST_F(ServedStation, a_new_list_holds_for_open_connections_too) {
    Peer reads(port, 0, 2), writes(port, 0, 3), goes(port, 0, 4);
    for (Peer* peer : {&reads, &writes, &goes}) EXPECT_EQ(refusal_of_a_write(*peer), 2);
    const auto use = [&](std::vector<AccessRule> list) { loop.on_loop([&] { server->set_access(std::move(list)); }); };
    use({{*parse_network("127.0.0.2"), false}, {*parse_network("127.0.0.3"), true}});
    EXPECT_EQ(refusal_of_a_write(reads), 1);
    EXPECT_TRUE(reads.asks());
    EXPECT_EQ(refusal_of_a_write(writes), 2);
    EXPECT_TRUE(goes.closed_by_server());
    EXPECT_EQ(statistics().connections, 2U);
    Peer again(port, 0, 4);
    EXPECT_TRUE(again.closed_by_server());
    use({{*parse_network("127.0.0.0/8"), true}});
    EXPECT_EQ(refusal_of_a_write(reads), 2) << "it may write again";
}

TEST_F(ServedStation, no_list_lets_anybody_write_on_the_read_only_port) {
    loop.on_loop([&] { server.reset(); });
    serve({.may_write = false});
    Peer peer(port);
    EXPECT_EQ(refusal_of_a_write(peer), 1);
    loop.on_loop([&] { server->set_access({{*parse_network("127.0.0.0/8"), true}}); });
    EXPECT_EQ(refusal_of_a_write(peer), 1);
}

TEST_F(ServedStation, a_taken_port_is_an_error_that_names_the_port_and_the_cure) {
    const auto second = loop.on_loop([&] { return Server::open(loop, image, {.host = "127.0.0.1", .port = port}); });
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_THAT(second.error().message(), HasSubstr(std::to_string(port)));
    EXPECT_THAT(second.error().cure, HasSubstr("another port"));
}

TEST_F(ServedStation, an_address_that_is_not_ours_is_an_error) {
    const auto foreign = loop.on_loop([&] { return Server::open(loop, image, {.host = "192.0.2.1", .port = 0}); });
    ASSERT_FALSE(foreign);
    EXPECT_EQ(foreign.error().code, ErrorCode::not_found);
    const auto nonsense = loop.on_loop([&] { return Server::open(loop, image, {.host = "no address", .port = 0}); });
    ASSERT_FALSE(nonsense);
    EXPECT_EQ(nonsense.error().code, ErrorCode::invalid_argument);
}

TEST_F(ServedStation, a_socket_opened_by_somebody_else_is_served) {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    ASSERT_EQ(::listen(fd, 4), 0);  // the kernel chooses the port
    auto adopted = loop.on_loop([&] { return Server::adopt(loop, image, fd, {.host = "127.0.0.1", .port = 502}); });
    ASSERT_TRUE(adopted) << adopted.error().message();
    EXPECT_EQ((*adopted)->address(), fmt::format("0.0.0.0:{}", (*adopted)->port()));  // not the configured one
    Peer peer((*adopted)->port());
    peer.send(kReadMagic);
    EXPECT_EQ(peer.receive(13), kMagicReply);
    loop.on_loop([&] { adopted->reset(); });
}

// deploy/hordd.toml has the default of firmware/config, and hordd.socket the same address.
TEST(Package, listens_on_this_machine_alone) {
    std::ifstream in(std::filesystem::path(HORD_SOURCE_DIR) / "deploy/hordd.socket");
    const std::string unit{std::istreambuf_iterator<char>(in), {}};
    EXPECT_THAT(unit, HasSubstr("\nListenStream=127.0.0.1:502\n"));
}

TEST_F(ServedStation, a_descriptor_that_does_not_listen_is_refused) {
    const auto adopted =
        loop.on_loop([&] { return Server::adopt(loop, image, ::socket(AF_INET, SOCK_STREAM, 0), {}); });
    ASSERT_FALSE(adopted);
    EXPECT_EQ(adopted.error().code, ErrorCode::invalid_argument);
}

TEST_F(ServedStation, nobody_at_the_address_is_a_clear_error_of_the_client) {
    loop.on_loop([&] { server.reset(); });
    const auto nobody = Client::connect({"127.0.0.1", port}, kPatience);
    ASSERT_FALSE(nobody);
    EXPECT_EQ(nobody.error().code, ErrorCode::disconnected);
    EXPECT_THAT(nobody.error().message(), HasSubstr(std::to_string(port)));
}

TEST(Endpoint, is_read_from_text) {
    const auto plain = parse_endpoint("station.local");
    ASSERT_TRUE(plain);
    EXPECT_EQ(plain->host, "station.local");
    EXPECT_EQ(plain->port, 502);
    EXPECT_EQ(parse_endpoint("10.0.0.5:1502")->port, 1502);
    EXPECT_EQ(parse_endpoint("[fe80::1]:1502")->host, "fe80::1");
    EXPECT_EQ(parse_endpoint("[::1]")->port, 502);
    for (const char* wrong : {"", ":502", "host:", "host:0", "host:65536", "host:5o2", "[::1", "[::1]x", "[::1]:"}) {
        EXPECT_FALSE(parse_endpoint(wrong)) << wrong;
    }
}

// -- an independent client

std::string output_of(const std::string& command) {
    std::string text;
    std::array<char, 4096> buffer{};
    FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
    while (const std::size_t count = std::fread(buffer.data(), 1, buffer.size(), pipe))
        text.append(buffer.data(), count);
    ::pclose(pipe);
    return text;
}

TEST_F(ServedStation, mbpoll_reads_ident_to_last) {
    if (std::system("command -v mbpoll >/dev/null") != 0)
        GTEST_SKIP() << "mbpoll is not installed (Debian package mbpoll)";
    Snapshot now;
    now.state = State::continuous_execution;
    now.counters.seen = 0x00010002;
    now.last.sequence = 77;
    now.last.verdict = PartVerdict::reject;
    image.publish(now);
    const std::string where = " -1 -0 -o 10 -p " + std::to_string(port) + " 127.0.0.1 ";
    const std::string ident = output_of("mbpoll -t 4:hex -r 0 -c 100" + where);
    EXPECT_THAT(ident, HasSubstr("[2]: \t0x484F"));
    EXPECT_THAT(ident, HasSubstr("[3]: \t0x5244"));
    EXPECT_THAT(output_of("mbpoll -t 4 -r 100 -c 40" + where), HasSubstr("[102]: \t8"));
    EXPECT_THAT(output_of("mbpoll -t 4:int -B -r 142 -c 10" + where), HasSubstr("[142]: \t65538"));
    EXPECT_THAT(output_of("mbpoll -t 3 -r 200 -c 100" + where), HasSubstr("[203]: \t77"));
    EXPECT_THAT(output_of("mbpoll -t 4 -r 9000 -c 1" + where), HasSubstr("Illegal data address"));
}

// A handler that accepts everything.
class Obedient : public PlcHandler {
  public:
    int commands = 0;
    CommandRequest last;
    CommandOutcome answer;
    CommandOutcome on_command(const Origin&, const CommandRequest& request) override {
        ++commands;
        last = request;
        return answer;
    }
    modbus::Exception on_acknowledged(const Origin&, std::uint32_t) override { return modbus::Exception::none; }
    void on_plc_lost(PlcPolicy) override {}
    void on_plc_back() override {}
};

class CommandedStation : public ServedStation {
  protected:
    Obedient station;
    PlcInterface desk{loop, station, {.boot_id = 0x1234B007}};
    RegisterServerModel full{StationIdentity{.firmware = "0.1.0", .boot_id = 0x1234B007}, &desk};
    void SetUp() override {
        auto opened = loop.on_loop([&] { return Server::open(loop, full, {.host = "127.0.0.1", .port = 0}); });
        ASSERT_TRUE(opened);
        server = std::move(*opened);
        port = server->port();
    }
};

TEST_F(CommandedStation, the_client_gives_a_command_and_its_outcome) {
    Client person = client();
    station.answer = {CommandState::completed, CommandError::none, 0xABCD0123};
    const auto done = person.command(Command::use_recipe, 0x00010002, 0x00030004, kPatience, "marie");
    ASSERT_TRUE(done) << done.error().message();
    EXPECT_EQ(done->state, CommandState::completed);
    EXPECT_EQ(done->result, 0xABCD0123U);
    EXPECT_EQ(station.last.code, static_cast<std::uint16_t>(Command::use_recipe));
    EXPECT_EQ(station.last.argument, 0x00010002U);
    EXPECT_EQ(station.last.argument2, 0x00030004U);
    EXPECT_EQ(station.last.boot, 0xB007);
    EXPECT_EQ(station.last.who.view(), "marie");
    EXPECT_NE(station.last.token, 0U);
    const std::uint32_t token = station.last.token;
    station.answer = {CommandState::failed, CommandError::device_down, 7};
    const auto refused = person.command(Command::arm, 0, 0, kPatience);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->state, CommandState::failed);
    EXPECT_EQ(refused->error, CommandError::device_down);
    EXPECT_EQ(refused->error_name, "device_down");
    EXPECT_EQ(station.last.who.view(), "");
    EXPECT_NE(station.last.token, token);
    EXPECT_EQ(station.commands, 2);
}

TEST_F(CommandedStation, a_refusal_by_the_state_names_the_state_of_after_it) {
    Client person = client();
    Snapshot now;
    now.state = State::halted;
    full.publish(now);
    station.answer = {CommandState::failed, CommandError::not_in_this_state, 0};
    const auto refused = person.command(Command::halt, 0, 0, kPatience);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->station_state, State::halted);
    EXPECT_EQ(refused->cure(), "the station is Halted: next is reset; possible are also commit_recipe, use_recipe");
}

TEST_F(CommandedStation, a_name_may_fill_its_registers_and_not_more) {
    Client person = client();
    const std::string longest(std::size_t{2} * find_register(BlockId::command, "who")->words, 'n');
    ASSERT_TRUE(person.command(Command::arm, 0, 0, kPatience, longest));
    EXPECT_EQ(station.last.who.view(), longest);
    EXPECT_EQ(person.command(Command::arm, 0, 0, kPatience, longest + "n").error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(station.commands, 1);
}

TEST_F(CommandedStation, a_command_that_is_not_done_in_time_says_so_and_is_not_given_twice) {
    Client person = client();
    station.answer = {CommandState::executing, CommandError::none, 0};
    const auto late = person.command(Command::self_test, 0, 0, std::chrono::milliseconds(0));
    ASSERT_FALSE(late);
    EXPECT_EQ(late.error().code, ErrorCode::timeout);
    EXPECT_EQ(station.commands, 1);
}

TEST_F(CommandedStation, a_command_waits_for_the_end_of_another) {
    Client one = client(), other = client();
    station.answer = {CommandState::executing, CommandError::none, 0};
    EXPECT_FALSE(one.command(Command::self_test, 0, 0, std::chrono::milliseconds(0)));
    const CommandRequest executing = station.last;
    station.answer = {CommandState::completed, CommandError::none, 0};
    EXPECT_EQ(other.command(Command::arm, 0, 0, std::chrono::milliseconds(0)).error().code, ErrorCode::busy);
    loop.on_loop([&] {
        loop.call_after(std::chrono::milliseconds(10), [&] {
            desk.finish(executing, {CommandState::completed, CommandError::none, 0});
        });
    });
    EXPECT_TRUE(other.command(Command::arm, 0, 0, kPatience));
}

TEST_F(CommandedStation, every_row_of_a_block_is_read) {
    Client reader = client();
    for (const BlockId id : {BlockId::ident, BlockId::status, BlockId::counters, BlockId::last, BlockId::plc}) {
        const auto readings = reader.read_block(id);
        ASSERT_TRUE(readings) << readings.error().message();
        EXPECT_EQ(readings->size(), find_block(id)->registers.size());
    }
}

TEST_F(CommandedStation, every_call_of_a_client_says_that_the_station_is_gone) {
    Client person = client();
    ASSERT_TRUE(person.read_block(BlockId::status));
    loop.on_loop([&] { server.reset(); });
    EXPECT_EQ(person.command(Command::arm, 0, 0, kPatience).error().code, ErrorCode::disconnected);
    EXPECT_EQ(person.read_result(1).error().code, ErrorCode::disconnected);
    EXPECT_EQ(person.read_block(BlockId::status).error().code, ErrorCode::disconnected);
}

TEST_F(ServedStation, a_request_that_does_not_fit_into_a_frame_is_refused_by_the_client) {
    Client person = client();
    EXPECT_EQ(person.read(0, 0).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(person.read(0, 126).error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(person.read(0, 125));
    EXPECT_EQ(person.write(8002, {}).error().code, ErrorCode::invalid_argument);
    const std::vector<std::uint16_t> many(124);
    EXPECT_EQ(person.write(8002, many).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(person.write(8002, std::span(many).first(123)).error().code, ErrorCode::refused) << "by the station";
    EXPECT_EQ(statistics().requests, 2U);
}

TEST_F(ServedStation, pymodbus_reads_writes_and_commands) {
    if (std::system("/usr/bin/python3 -c 'import pymodbus.client' 2>/dev/null") != 0) {
        GTEST_SKIP() << "pymodbus is not installed (Debian packages python3-pymodbus python3-serial-asyncio)";
    }
    Obedient station;
    PlcInterface desk(loop, station, {});
    RegisterServerModel full(StationIdentity{.firmware = "0.1.0"}, &desk);
    Snapshot now;
    now.state = State::ready;
    now.run_permit = true;
    full.publish(now);
    loop.on_loop([&] {
        server.reset();
        server = std::move(*Server::open(loop, full, {.host = "127.0.0.1", .port = 0}));
    });
    const std::string said =
        output_of("/usr/bin/python3 " HORD_SOURCE_DIR "/tests/firmware/modbus/pymodbus_reads_the_station.py " +
                  std::to_string(server->port()));
    EXPECT_EQ(said,
              "block 1 at 0\nblock 2 at 100\nblock 3 at 140\nblock 4 at 200\nblock 0 at 300\nblock 5 at "
              "998\nblock 0 at 7144\n"
              "block 6 at 8000\nblock 7 at 8020\nblock 8 at 8100\nblock 9 at 8200\nblock 0 at 8300\nblock 10 "
              "at 8400\n"
              "block 11 at 8500\nblock 65535 at 8600\n"
              "mirrored\nstate 6\nbits 01000000\nexception 2\ncommand written\nreply [0, 71, 2, 2, 0]\n"
              "reply [0, 72, 6, 2, 0]\nheartbeat 7\nheartbeat 1\nidentity HORD station 0.1.0\n");
    loop.on_loop([&] { server.reset(); });
    EXPECT_EQ(station.commands, 2) << "the repeated token did nothing";
}

}  // namespace
}  // namespace hord::firmware::modbus
