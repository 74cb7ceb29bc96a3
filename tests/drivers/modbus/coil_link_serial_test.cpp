// What the link to a module makes of the bytes on a serial line: a pseudo-terminal whose other end the test holds.
#include <array>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

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

TEST_F(SerialLink, takes_no_answer_whose_checksum_is_wrong_and_asks_again) {
    CoilLink link(*loop_, address_, 10s);
    ASSERT_TRUE(link.connect());
    std::jthread module([&] {
        EXPECT_EQ(hear(kRequest.size()), kRequest);
        say(kIsOn.substr(0, 5) + '\xC1');
        EXPECT_EQ(hear(kRequest.size()), kRequest);
        say(kIsOff);
    });
    const auto read = link.read(5);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_FALSE(*read);
}

TEST_F(SerialLink, takes_nothing_that_came_before_its_request_for_the_answer) {
    CoilLink link(*loop_, address_, 10s);
    ASSERT_TRUE(link.connect());
    say(kIsOn);
    wait_until_they_arrived();
    {
        std::jthread module([&] {
            EXPECT_EQ(hear(kRequest.size()), kRequest);
            say(kIsOff);
        });
        const auto read = link.read(5);
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_FALSE(*read);
    }
    const auto identification = [](const std::string& text) {
        return std::string("\7\x2b\xe\1\1\0\0\1\0", 9) + static_cast<char>(text.size()) + text + "\xAB\xCD";
    };
    say(identification("before"));
    wait_until_they_arrived();
    std::jthread module([&] {
        (void)hear(7);
        say(identification("now"));
    });
    EXPECT_EQ(link.identify().value_or("nothing"), "now");
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
