// What the link to a module makes of the bytes on a serial line: a pseudo-terminal whose other end the test holds.
#include <array>
#include <filesystem>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include "common/crc16.h"
#include "common/unique_fd.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/modbus/coil_link.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

class SerialLink : public testing::Test {
  protected:
    SerialLink() {
        ::grantpt(far_.get());
        ::unlockpt(far_.get());
        near_ = common::UniqueFd(::open(::ptsname(far_.get()), O_RDWR | O_NOCTTY | O_CLOEXEC));
        termios raw{};
        ::cfmakeraw(&raw);
        ::tcsetattr(near_.get(), TCSANOW, &raw);
        address_.serial =
            SerialSettings{.device = ::ptsname(far_.get()), .baud = 115'200, .parity = 'N', .rs485 = false};
    }
    void say(const std::string& bytes) const { (void)!::write(far_.get(), bytes.data(), bytes.size()); }
    [[nodiscard]] std::string hear(std::size_t size) const {
        std::string heard;
        std::array<char, 64> bytes{};
        while (heard.size() < size) {
            pollfd ready{far_.get(), POLLIN, 0};
            if (::poll(&ready, 1, 20'000) != 1) break;  // nobody asks: the test fails
            const ssize_t count = ::read(far_.get(), bytes.data(), size - heard.size());
            if (count <= 0) break;
            heard.append(bytes.data(), static_cast<std::size_t>(count));
        }
        return heard;
    }
    // A thread of the kernel carries the bytes from end to end.
    void wait_until_they_arrived() const {
        pollfd arrived{near_.get(), POLLIN, 0};
        ASSERT_EQ(::poll(&arrived, 1, 60'000), 1);
    }

    common::UniqueFd far_{::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)}, near_;
    std::unique_ptr<firmware::SdEventLoop> loop_ = std::move(*firmware::SdEventLoop::open());
    ModuleAddress address_{.unit = 7};
};

// Reading coil 5 of unit 7, with their checksums.
const std::string kRequest("\x07\x01\x00\x05\x00\x01\xED\xAD", 8);
const std::string kIsOn("\x07\x01\x01\x01\x90\xC0", 6), kIsOff("\x07\x01\x01\x00\x51\x00", 6);
const std::string kDamaged = kIsOn.substr(0, 5) + '\xC1';
const std::string kOfAnother("\x09\x01\x01\x01\x92\x28", 6);

TEST_F(SerialLink, takes_no_answer_whose_checksum_is_wrong_and_asks_again) {
    CoilLink link(*loop_, address_, 10s);
    ASSERT_TRUE(link.connect());
    const hal::TimePoint from = loop_->now();
    const auto read_of = [&](const std::string& first, const std::string& second) {
        std::jthread module([&] {
            EXPECT_EQ(hear(kRequest.size()), kRequest);
            say(first);
            EXPECT_EQ(hear(kRequest.size()), kRequest);
            say(second);
        });
        return link.read(5);
    };
    EXPECT_FALSE(read_of(kDamaged, kIsOff).value());
    EXPECT_TRUE(read_of(kOfAnother, kIsOn).value());
    const auto twice = read_of(kDamaged, kDamaged);
    ASSERT_FALSE(twice);
    EXPECT_EQ(twice.error().code, ErrorCode::disconnected);
    EXPECT_THAT(twice.error().what, HasSubstr("the answer is damaged or none of Modbus"));
    EXPECT_THAT(twice.error().cure, HasSubstr("rejector.baud"));
    ASSERT_TRUE(link.connect());
    const auto another = read_of(kOfAnother, kOfAnother);
    ASSERT_FALSE(another);
    EXPECT_THAT(another.error().what, HasSubstr("unit 9 answers, not unit 7"));
    EXPECT_LT(loop_->now() - from, 10s) << "a frame's gap after a damaged answer, not a time-out";
}

TEST_F(SerialLink, takes_nothing_that_came_before_its_request_for_the_answer) {
    CoilLink link(*loop_, address_, 10s);
    ASSERT_TRUE(link.connect());
    say(kIsOn);
    wait_until_they_arrived();
    std::jthread module([&] {
        EXPECT_EQ(hear(kRequest.size()), kRequest);
        say(kIsOff);
    });
    EXPECT_FALSE(link.read(5).value());
}

std::string with_crc(std::string frame) {
    std::vector<std::uint8_t> bytes(frame.begin(), frame.end());
    bytes.resize(bytes.size() + common::kCrc16Bytes);
    common::write_crc16(bytes);
    return {bytes.begin(), bytes.end()};
}

std::string identification(const std::string& text) {
    return with_crc(std::string("\7\x2b\xe\1\1\0\0\1\0", 9) + static_cast<char>(text.size()) + text);
}

TEST_F(SerialLink, takes_what_comes_after_its_question_for_what_the_module_is) {
    CoilLink link(*loop_, address_, 20s);
    ASSERT_TRUE(link.connect());
    say(identification("before"));
    wait_until_they_arrived();
    std::jthread module([&] {
        EXPECT_EQ(hear(7), std::string("\x07\x2B\x0E\x01\x00\xF8\x77", 7));
        std::this_thread::sleep_for(100ms);  // it may think
        const std::string now = identification("now");
        say(now.substr(0, 8));
        std::this_thread::sleep_for(100ms);  // a slow line, or an adapter that collects bytes
        say(now.substr(8));
    });
    const hal::TimePoint from = loop_->now();
    EXPECT_EQ(link.identify().value_or("nothing"), "now");
    EXPECT_LT(loop_->now() - from, 10s) << "it ends with its checksum and a pause";
    EXPECT_FALSE(link.connected());
}

TEST_F(SerialLink, takes_no_damaged_answer_for_what_the_module_is) {
    CoilLink link(*loop_, address_, 200ms);
    for (const std::size_t at : {1U, 10U, 13U}) {  // the function, a letter, the checksum
        ASSERT_TRUE(link.connect());
        std::jthread module([&] {
            EXPECT_EQ(hear(7).size(), 7U);
            std::string damaged = identification("now");
            damaged.at(at) ^= 4;
            say(damaged);
        });
        const auto said = link.identify();
        ASSERT_FALSE(said) << at << ": " << *said;
        EXPECT_EQ(said.error().code, ErrorCode::unreadable);
        EXPECT_THAT(said.error().what, HasSubstr("damaged"));
        EXPECT_THAT(said.error().cure, HasSubstr("rejector.baud"));
    }
}

TEST_F(SerialLink, has_acknowledged_a_write_whose_answer_was_lost_when_it_was_read_back) {
    CoilLink link(*loop_, address_, 10s);
    ASSERT_TRUE(link.connect());
    hal::TimePoint read_back;
    std::jthread module([&] {
        EXPECT_EQ(hear(8), std::string("\x07\x05\x00\x05\xFF\x00\x9C\x5D", 8));
        say(kDamaged);
        EXPECT_EQ(hear(8), kRequest);
        std::this_thread::sleep_for(20ms);
        read_back = loop_->now();
        say(kIsOn);
    });
    ASSERT_TRUE(link.write(5, true));
    module.join();
    EXPECT_GE(link.acknowledged(), read_back);
}

TEST_F(SerialLink, that_lost_the_answer_to_a_write_and_is_refused_its_reading_back_stays) {
    CoilLink link(*loop_, address_, 300ms);
    ASSERT_TRUE(link.connect());
    std::jthread module([&] {
        (void)hear(8);
        (void)hear(8);
        say("\x07\x81\x04\xA1\x92");
    });
    const auto written = link.write(5, true);
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().code, ErrorCode::refused);
    EXPECT_THAT(written.error().what, HasSubstr("cannot be read back"));
    EXPECT_TRUE(link.connected());
}

TEST_F(SerialLink, that_was_to_give_up_before_does_not_wait) {
    CoilLink link(*loop_, address_, 10s);
    const hal::TimePoint from = loop_->now();
    ASSERT_TRUE(link.connect());
    link.give_up_at(from - 1s);
    const auto read = link.read(5);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::timeout);
    EXPECT_LT(loop_->now() - from, 10s);
}

TEST_F(SerialLink, sets_its_line_as_is_said_and_closes_it) {
    const auto descriptors = [] {
        return std::distance(std::filesystem::directory_iterator("/proc/self/fd"),
                             std::filesystem::directory_iterator());
    };
    struct Case {
        char parity;
        int baud;
        speed_t speed;
        tcflag_t flags;
    };
    for (const Case& one :
         {Case{'N', 1200, B1200, CSTOPB}, Case{'E', 19'200, B19200, 0}, Case{'O', 115'200, B115200, PARODD}}) {
        address_.serial->parity = one.parity;
        address_.serial->baud = one.baud;
        const auto before = descriptors();
        CoilLink link(*loop_, address_, 10s);
        const hal::TimePoint from = loop_->now();
        ASSERT_TRUE(link.connect());
        if (one.baud == 1200) {
            EXPECT_GE(loop_->now() - from, 32'500us) << "an earlier answer may still come: it waits for a frame's gap";
        }
        termios line{};
        ASSERT_EQ(::tcgetattr(near_.get(), &line), 0);
        EXPECT_EQ(line.c_cflag & (CSTOPB | PARODD), one.flags) << "a pseudo-terminal keeps no other";
        EXPECT_EQ(::cfgetospeed(&line), one.speed);
        link.close();
        EXPECT_EQ(descriptors(), before);
    }
}

TEST_F(SerialLink, on_an_adapter_that_cannot_switch_its_transmitter_names_rs485) {
    address_.serial->rs485 = true;
    CoilLink link(*loop_, address_, 10s);
    const auto refused = link.connect();
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::io);
    EXPECT_THAT(refused.error().what, HasSubstr(address_.serial->device + " cannot be opened"));
    EXPECT_THAT(refused.error().cure, HasSubstr("rejector.rs485"));
    EXPECT_FALSE(link.connected());
}

}  // namespace
}  // namespace hord::drivers
