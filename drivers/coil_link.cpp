#include "drivers/coil_link.h"

#include <modbus/modbus.h>

#include <algorithm>
#include <cerrno>

namespace hord::drivers {

struct CoilLink::Context {
    modbus_t* modbus = nullptr;
    explicit Context(modbus_t* m) : modbus(m) {}
    ~Context() {
        if (modbus == nullptr) return;
        modbus_close(modbus);
        modbus_free(modbus);
    }
    Context(const Context&) = delete;
    Context& operator=(const Context&) = delete;
};

CoilLink::CoilLink(const hal::Clock& clock, std::string host, int port, int unit)
    : clock_(clock), host_(std::move(host)), port_(port), unit_(unit) {}
CoilLink::~CoilLink() = default;

void CoilLink::wait_at_most(hal::Duration timeout) {
    const auto us = std::max<std::int64_t>(1000, std::chrono::duration_cast<std::chrono::microseconds>(timeout).count());
    modbus_set_response_timeout(context_->modbus, static_cast<std::uint32_t>(us / 1000000), static_cast<std::uint32_t>(us % 1000000));
    // No time-out between bytes: the one above then holds for the whole answer, and a module that drips cannot stretch it.
    modbus_set_byte_timeout(context_->modbus, 0, 0);
}

Result<void> CoilLink::connect(hal::Duration timeout) {
    close();
    context_ = std::make_unique<Context>(modbus_new_tcp_pi(host_.c_str(), std::to_string(port_).c_str()));
    if (context_->modbus == nullptr) {
        return fail(ErrorCode::io, "no Modbus context for the rejector at " + name(), "check rejector.host and rejector.port");
    }
    modbus_set_slave(context_->modbus, unit_);
    wait_at_most(timeout);
    if (modbus_connect(context_->modbus) == 0) {
        connected_ = true;
        return {};
    }
    const int error = errno;
    context_.reset();
    const bool unanswered = error == ETIMEDOUT || error == EINPROGRESS;
    return fail(unanswered ? ErrorCode::timeout : ErrorCode::disconnected,
                "the rejector module at " + name() + (unanswered ? " does not answer" : std::string(" cannot be reached: ") + modbus_strerror(error)),
                "check its power and cable, rejector.host and rejector.port");
}

void CoilLink::close() {
    context_.reset();
    connected_ = false;
}

tl::unexpected<Error> CoilLink::failed(const char* what, int coil, int error) {
    const std::string which = "coil " + std::to_string(coil) + " of the rejector module at " + name();
    if (error > MODBUS_ENOBASE && error <= MODBUS_ENOBASE + MODBUS_EXCEPTION_MAX) {
        return fail(ErrorCode::refused, which + " cannot be " + what + ": " + modbus_strerror(error),
                    "check the coil's number and the module's own fault display");
    }
    close();
    return fail(error == ETIMEDOUT ? ErrorCode::timeout : ErrorCode::disconnected,
                which + " cannot be " + what + ": " + modbus_strerror(error), "check the module's power and cable; the driver keeps trying");
}

Result<bool> CoilLink::read(int coil, hal::Duration timeout) {
    if (!connected_) return failed("read", coil, ENOTCONN);
    wait_at_most(timeout);
    std::uint8_t value = 0;
    if (modbus_read_bits(context_->modbus, coil, 1, &value) != 1) return failed("read", coil, errno);
    return value != 0;
}

Result<void> CoilLink::write(int coil, bool on, hal::Duration timeout) {
    if (!connected_) return failed("written", coil, ENOTCONN);
    const hal::TimePoint by = clock_.now() + timeout;
    wait_at_most(timeout);
    if (modbus_write_bit(context_->modbus, coil, on ? 1 : 0) != 1) return failed("written", coil, errno);
    const auto back = read(coil, by - clock_.now());
    if (!back) return tl::unexpected(back.error());
    if (*back == on) return {};
    return fail(ErrorCode::refused, "coil " + std::to_string(coil) + " of the rejector module at " + name() + " does not read back as written",
                "check that nothing else writes it and that the output is not forced");
}

}  // namespace hord::drivers
