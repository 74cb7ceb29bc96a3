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

#include "common/crc16.h"
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
    void open(SerialOptions options = {}) {
        options.device = device;
        options.unit = 17;
        options.rs485 = false;
        auto made = loop.on_loop([&] { return RtuServer::open(loop, image, options); });
        ASSERT_TRUE(made) << made.error().message();
        server = std::move(*made);
    }
    [[nodiscard]] termios settings() const {
        termios now{};
        EXPECT_EQ(::tcgetattr(other_end, &now), 0);
        return now;
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
    common::write_crc16(request);
    Bytes broadcast{0, 6, 0, 1, 0, 2, 0, 0};
    common::write_crc16(broadcast);
    ASSERT_EQ(::write(other_end, broadcast.data(), broadcast.size()), 8);
    ASSERT_EQ(::write(other_end, request.data(), request.size()), 8);
    Bytes reply{17, 3, 4, 'H', 'O', 'R', 'D', 0, 0};
    common::write_crc16(reply);
    EXPECT_EQ(receive(reply.size()), reply);
}

TEST_F(Serial, a_request_may_come_byte_by_byte) {
    open({.gap = std::chrono::seconds(10)});
    Bytes request{17, 3, 0, 2, 0, 2, 0, 0};
    common::write_crc16(request);
    for (const std::uint8_t byte : request) {
        ASSERT_EQ(::write(other_end, &byte, 1), 1);
        loop.on_loop([] { return 0; });
    }
    EXPECT_EQ(receive(9).size(), 9U);
}

// The line's buffer takes a part of a reply: the rest follows, and what was asked meanwhile is given up.
TEST_F(Serial, every_reply_is_whole_even_when_the_master_does_not_read) {
    open();
    Bytes request{17, 3, 0, 0, 0, 125, 0, 0};
    common::write_crc16(request);
    for (int k = 0; k < 600; ++k) {
        (void)!::write(other_end, request.data(), request.size());
        loop.on_loop([] { return 0; });
    }
    int whole = 0;
    Bytes reply;
    const auto frame_is_good = [&] {
        const std::uint16_t crc = common::crc16(std::span(reply).first(253));
        return reply[253] == (crc & 0xFFU) && reply[254] == crc >> 8U;
    };
    pollfd ready{other_end, POLLIN, 0};
    while (::poll(&ready, 1, 50) > 0) {
        reply = receive(255);
        ASSERT_EQ(reply.size(), 255U);
        ASSERT_TRUE(frame_is_good()) << "reply " << whole;
        ++whole;
    }
    EXPECT_GT(whole, 10);
    EXPECT_LT(whole, 600) << "the buffer was never full";
    ASSERT_EQ(::write(other_end, request.data(), request.size()), 8);
    reply = receive(255);
    ASSERT_EQ(reply.size(), 255U);
    EXPECT_TRUE(frame_is_good());
}

TEST_F(Serial, the_line_is_raw_with_the_speed_and_parity_that_are_wanted) {
    using Parity = SerialOptions::Parity;
    for (const Parity parity : {Parity::none, Parity::even, Parity::odd}) {
        termios left = settings();
        left.c_cflag |= PARODD | CSTOPB | CRTSCTS;
        left.c_lflag |= ECHO | ICANON;
        ASSERT_EQ(::tcsetattr(other_end, TCSANOW, &left), 0);
        open({.baud = 57600, .parity = parity});
        const termios now = settings();
        EXPECT_EQ((now.c_cflag & PARODD) != 0, parity == Parity::odd);
        EXPECT_EQ((now.c_cflag & CSTOPB) != 0, parity == Parity::none) << "two stop bits in place of the parity";
        EXPECT_EQ(now.c_cflag & CRTSCTS, 0U);
        EXPECT_NE(now.c_cflag & CLOCAL, 0U);
        EXPECT_EQ(now.c_lflag & (ECHO | ICANON), 0U);
        EXPECT_EQ(::cfgetospeed(&now), speed_t{B57600});
        loop.on_loop([&] { server.reset(); });
    }
}

TEST_F(Serial, a_broadcast_is_not_answered) {
    open();
    Bytes broadcast{0, 3, 0, 2, 0, 2, 0, 0}, request{17, 3, 0, 3, 0, 1, 0, 0};
    common::write_crc16(broadcast);
    common::write_crc16(request);
    ASSERT_EQ(::write(other_end, broadcast.data(), broadcast.size()), 8);
    ASSERT_EQ(::write(other_end, request.data(), request.size()), 8);
    Bytes reply{17, 3, 2, 'R', 'D', 0, 0};
    common::write_crc16(reply);
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
