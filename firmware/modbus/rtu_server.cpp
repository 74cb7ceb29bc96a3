#include "firmware/modbus/rtu_server.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/serial.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include "common/assign.h"
#include "common/crc16.h"
#include "common/unique_fd.h"
#include "firmware/modbus/framer_rtu.h"

namespace hord::firmware::modbus {
namespace {

using namespace std::chrono_literals;

constexpr auto kRetry = 1s;

struct Speed {
    int baud;
    speed_t code;
};
constexpr Speed kSpeeds[] = {{1200, B1200},     {2400, B2400},     {4800, B4800},    {9600, B9600},
                             {19200, B19200},   {38400, B38400},   {57600, B57600},  {115200, B115200},
                             {230400, B230400}, {460800, B460800}, {921600, B921600}};

// Configures the open line: raw, 8 bits, parity, speed, RS-485.
Result<void> set_up(int fd, const SerialOptions& options) {
    const auto* speed = std::ranges::find(kSpeeds, options.baud, &Speed::baud);
    if (speed == std::end(kSpeeds)) {
        return fail(ErrorCode::unsupported, fmt::format("{} baud is not a speed of {}", options.baud, options.device),
                    "use 1200, 2400, ... 115200, 230400, 460800 or 921600");
    }
    termios line{};
    if (::tcgetattr(fd, &line) != 0) {
        return fail(ErrorCode::unsupported, fmt::format("{} is not a serial line", options.device),
                    "name a device such as /dev/ttyS0");
    }
    ::cfmakeraw(&line);
    ::cfsetspeed(&line, speed->code);
    line.c_cflag |= CLOCAL | CREAD;
    line.c_cflag &= ~static_cast<tcflag_t>(PARENB | PARODD | CSTOPB | CRTSCTS);
    if (options.parity == SerialOptions::Parity::none) line.c_cflag |= CSTOPB;
    if (options.parity != SerialOptions::Parity::none) line.c_cflag |= PARENB;
    if (options.parity == SerialOptions::Parity::odd) line.c_cflag |= PARODD;
    if (::tcsetattr(fd, TCSANOW, &line) != 0) {
        return fail(ErrorCode::io, fmt::format("{} cannot be set up: {}", options.device, std::strerror(errno)),
                    "check the adapter");
    }
    if (options.rs485) {
        serial_rs485 rs485{};
        rs485.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND;
        if (::ioctl(fd, TIOCSRS485, &rs485) != 0) {
            return fail(ErrorCode::unsupported,
                        fmt::format("{} has no RS-485 mode: {}", options.device, std::strerror(errno)),
                        "use a port whose driver has it, or switch it off for RS-232 and for adapters that "
                        "switch by themselves");
        }
    }
    ::tcflush(fd, TCIOFLUSH);
    return {};
}

Result<common::UniqueFd> open_line(const SerialOptions& options) {
    common::UniqueFd fd(::open(options.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (!fd) {
        const int error = errno;
        const ErrorCode code = error == EBUSY   ? ErrorCode::busy
            : error == EACCES || error == EPERM ? ErrorCode::refused
                                                : ErrorCode::not_found;
        return fail(code, fmt::format("serial line {} cannot be opened: {}", options.device, std::strerror(error)),
                    "check the name, the group dialout, and that no other program uses it");
    }
    if (auto done = set_up(fd.get(), options); !done) return tl::unexpected(done.error());
    if (::ioctl(fd.get(), TIOCEXCL) != 0)
        return fail(ErrorCode::busy, fmt::format("serial line {} is in use", options.device), "stop the other program");
    return fd;
}

}  // namespace

struct RtuServer::Impl {
    hal::EventLoop& loop;
    RegisterModel& model;
    const SerialOptions options;
    common::UniqueFd fd;
    hal::EventLoop::WatchId watch = hal::EventLoop::WatchId::none;
    hal::EventLoop::TimerId retry = hal::EventLoop::TimerId::none;
    FramerRtu framer;
    std::array<std::uint8_t, kMaxRtuFrame> reply{};
    std::size_t filled = 0, sent = 0;

    Impl(hal::EventLoop& l, RegisterModel& m, SerialOptions o)
        : loop(l), model(m), options(std::move(o)), framer(options.unit, options.gap) {}
    ~Impl() {
        loop.cancel(retry);
        loop.unwatch(watch);
    }
    Impl(const Impl&) = delete;
    Impl& operator=(const Impl&) = delete;

    Result<void> open() {
        if (auto done = assign(fd, open_line(options)); !done) return done;
        return wait_for(hal::EventLoop::Readiness::readable);
    }

    Result<void> wait_for(hal::EventLoop::Readiness what) {
        loop.unwatch(std::exchange(watch, hal::EventLoop::WatchId::none));
        const auto handler = what == hal::EventLoop::Readiness::readable ? &Impl::on_readable : &Impl::on_writable;
        return assign(watch, loop.watch(fd.get(), what, [this, handler] { (this->*handler)(); }));
    }

    void lost() {
        loop.unwatch(std::exchange(watch, hal::EventLoop::WatchId::none));
        fd.reset();
        retry = loop.call_after(kRetry, [this] {
            if (!open()) lost();
        });
    }

    void on_readable() {
        std::array<std::uint8_t, kMaxRtuFrame> input;
        const ssize_t count = ::read(fd.get(), input.data(), input.size());
        if (count < 0 && (errno == EAGAIN || errno == EINTR)) return;
        if (count <= 0) return lost();
        std::span<const std::uint8_t> bytes(input.data(), static_cast<std::size_t>(count));
        const hal::TimePoint now = loop.now();
        while (const auto request = framer.take(bytes, now)) answer(*request);
        if (filled > 0) send_reply();
    }

    // Only the newest request is answered: a master that sends again has given up the older one.
    void answer(const Request& request) {
        std::array<std::uint8_t, kMaxPdu> pdu{};
        const std::size_t size =
            dispatch(model, {.peer = options.device, .may_write = options.may_write}, request.pdu, pdu);
        if (request.unit == 0) return;  // a broadcast
        reply[0] = options.unit;
        std::copy_n(pdu.begin(), size, reply.begin() + 1);
        common::write_crc16(std::span(reply).first(size + 3));
        filled = size + 3;
        sent = 0;
    }

    void send_reply() {
        const ssize_t count = ::write(fd.get(), reply.data() + sent, filled - sent);
        if (count < 0 && errno != EAGAIN && errno != EINTR) return lost();
        if (count > 0) sent += static_cast<std::size_t>(count);
        const bool done = sent == filled;
        if (done) filled = sent = 0;
        if (!wait_for(done ? hal::EventLoop::Readiness::readable : hal::EventLoop::Readiness::writable)) lost();
    }

    void on_writable() {
        ::tcflush(fd.get(), TCIFLUSH);
        send_reply();
    }
};

RtuServer::RtuServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RtuServer::~RtuServer() = default;

Result<std::unique_ptr<RtuServer>> RtuServer::open(hal::EventLoop& loop, RegisterModel& model, SerialOptions options) {
    if (options.unit < 1 || options.unit > 247) {
        return fail(ErrorCode::invalid_argument, fmt::format("{} is not a unit of a serial line", options.unit),
                    "use 1 to 247");
    }
    auto impl = std::make_unique<Impl>(loop, model, std::move(options));
    if (auto opened = impl->open(); !opened) return tl::unexpected(opened.error());
    return std::unique_ptr<RtuServer>(new RtuServer(std::move(impl)));
}

}  // namespace hord::firmware::modbus
