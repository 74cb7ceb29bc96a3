// The RTU server on a pseudo-terminal: with libmodbus as master, and with bytes.
#include "firmware/modbus/rtu_server.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>
#include <termios.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "firmware/modbus/framer_rtu.h"
#include "tests/firmware/modbus/modbus_peer.h"

namespace hord::firmware::modbus {
namespace {

using ::testing::HasSubstr;

class Serial : public ::testing::Test {
  protected:
    PollLoop loop;
    RegisterServerModel image{StationIdentity{.firmware = "0.1.0"}};
    int other_end = ::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    std::string device;
    std::unique_ptr<RtuServer> server;

    void SetUp() override {
        ASSERT_GE(other_end, 0);
        ASSERT_EQ(::grantpt(other_end), 0);
        ASSERT_EQ(::unlockpt(other_end), 0);
        device = ::ptsname(other_end);
    }
    void TearDown() override {
        loop.on_loop([&] { server.reset(); });
        if (other_end >= 0) ::close(other_end);
    }
    void open() {
        auto made =
            loop.on_loop([&] { return RtuServer::open(loop, image, {.device = device, .unit = 17, .rs485 = false}); });
        ASSERT_TRUE(made) << made.error().message();
        server = std::move(*made);
    }
    Bytes receive(std::size_t size) {
        Bytes all;
        while (all.size() < size) {
            pollfd ready{other_end, POLLIN, 0};
            if (::poll(&ready, 1, kPatienceMs) <= 0) break;
            std::uint8_t byte = 0;
            if (::read(other_end, &byte, 1) == 1) all.push_back(byte);
        }
        return all;
    }
};

TEST_F(Serial, libmodbus_reads_and_is_refused_over_the_line) {
    open();
    modbus_t* master = modbus_new_rtu(device.c_str(), 115200, 'N', 8, 1);
    ASSERT_NE(master, nullptr);
    modbus_set_slave(master, 17);
    modbus_set_response_timeout(master, kPatienceMs / 1000, 0);
    ASSERT_EQ(modbus_set_socket(master, other_end), 0);
    std::array<std::uint16_t, 125> words{};
    for (int k = 0; k < 20; ++k) {
        ASSERT_EQ(modbus_read_registers(master, 0, 125, words.data()), 125) << modbus_strerror(errno);
        EXPECT_EQ(words[2], 0x484F);
    }
    EXPECT_EQ(modbus_read_registers(master, 400, 1, words.data()), -1);
    EXPECT_EQ(errno, EMBXILADD);
    modbus_free(master);
}

TEST_F(Serial, a_device_is_opened_set_up_and_answered_on) {
    open();
    Bytes request{17, 3, 0, 2, 0, 2, 0, 0};
    write_crc16(request);
    Bytes broadcast{0, 6, 0, 1, 0, 2, 0, 0};
    write_crc16(broadcast);
    ASSERT_EQ(::write(other_end, broadcast.data(), broadcast.size()), 8);
    ASSERT_EQ(::write(other_end, request.data(), request.size()), 8);
    Bytes reply{17, 3, 4, 'H', 'O', 'R', 'D', 0, 0};
    write_crc16(reply);
    EXPECT_EQ(receive(reply.size()), reply);
}

TEST_F(Serial, what_cannot_be_opened_is_an_error_with_a_cure) {
    const auto open = [&](const SerialOptions& options) {
        return loop.on_loop([&] { return RtuServer::open(loop, image, options); });
    };
    const auto absent = open({.device = "/dev/no-such-line"});
    ASSERT_FALSE(absent);
    EXPECT_EQ(absent.error().code, ErrorCode::not_found);
    EXPECT_THAT(absent.error().message(), HasSubstr("/dev/no-such-line"));
    EXPECT_EQ(open({.device = "/dev/null"}).error().code, ErrorCode::unsupported);
    EXPECT_EQ(open({.device = device, .baud = 12345}).error().code, ErrorCode::unsupported);
    EXPECT_EQ(open({.device = device, .unit = 0}).error().code, ErrorCode::invalid_argument);
    const auto no_rs485 = open({.device = device, .rs485 = true});
    ASSERT_FALSE(no_rs485) << "a pseudo-terminal has no RS-485 mode";
    EXPECT_EQ(no_rs485.error().code, ErrorCode::unsupported);
}

// The service's own loop, not the tests' one.
TEST(ServerOnTheServicesLoop, serves_evicts_and_closes) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop) << loop.error().message();
    RegisterServerModel image(StationIdentity{});
    auto server = Server::open(**loop, image, {.host = "127.0.0.1", .port = 0, .max_connections = 2});
    ASSERT_TRUE(server) << server.error().message();
    std::thread clients([&, port = (*server)->port()] {
        for (int k = 0; k < 50; ++k) {
            Peer garbage(port), partial(port), good(port);
            garbage.send({'G', 'E', 'T', ' ', '/', ' ', 'H'});
            partial.send({0, 1, 0});
            good.send(kReadMagic);
            EXPECT_EQ(good.receive(13), kMagicReply);
        }
        (*loop)->request_stop();
    });
    EXPECT_TRUE((*loop)->run());
    clients.join();
    EXPECT_EQ((*server)->statistics().requests, 50U);
    server->reset();
}

}  // namespace
}  // namespace hord::firmware::modbus
