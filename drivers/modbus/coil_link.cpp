#include "drivers/modbus/coil_link.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <thread>

#include <modbus/modbus.h>
#include <poll.h>
#include <unistd.h>

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using hal::Duration;

// A frame ends with 3.5 characters of silence (1.75 ms from 19200 baud up). At least 2 ms, because adapters deliver
// bytes in batches.
Duration frame_gap(const ModuleAddress& address) {
    if (!address.serial) return 0ns;
    const Duration characters = address.serial->baud > 0 ? Duration(std::chrono::seconds(1)) * 39 / address.serial->baud
                                                         : 0ns;  // 3.5 of 11 bits
    return std::max<Duration>(2ms, characters);
}

bool is_exception(int error) {
    return error > MODBUS_ENOBASE && error < MODBUS_ENOBASE + MODBUS_EXCEPTION_MAX;
}  // EMBBADCRC is the next one
bool is_damage(int error) {
    return error == EMBBADCRC || error == EMBBADDATA || error == EMBMDATA || error == EMBBADSLAVE || error == EMBBADEXC;
}

}  // namespace

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

CoilLink::CoilLink(const hal::Clock& clock, ModuleAddress address)
    : clock_(clock), address_(std::move(address)), gap_(frame_gap(address_)) {}
CoilLink::~CoilLink() = default;

std::string CoilLink::name() const {
    if (address_.serial) return address_.serial->device + " unit " + std::to_string(address_.unit);
    return address_.host + ":" + std::to_string(address_.port);
}
std::string CoilLink::which(const char* thing, int number) const {
    return std::string(thing) + " " + std::to_string(number) + " of the rejector module at " + name();
}

void CoilLink::wait_at_most(Duration timeout) {
    if (give_up_ != hal::TimePoint::max()) timeout = std::min(timeout, give_up_ - clock_.now());
    const auto us =
        std::max<std::int64_t>(1000, std::chrono::duration_cast<std::chrono::microseconds>(timeout).count());
    modbus_set_response_timeout(context_->modbus, static_cast<std::uint32_t>(us / 1000000),
                                static_cast<std::uint32_t>(us % 1000000));
    // Without a time-out between bytes the one above limits the whole answer, also of a module that sends slowly.
    modbus_set_byte_timeout(context_->modbus, 0, 0);
}

Result<void> CoilLink::connect(Duration timeout) {
    close();
    const auto& serial = address_.serial;
    context_ = std::make_unique<Context>(
        serial ? modbus_new_rtu(serial->device.c_str(), serial->baud, serial->parity, 8, serial->parity == 'N' ? 2 : 1)
               : modbus_new_tcp_pi(address_.host.c_str(), std::to_string(address_.port).c_str()));
    const char* keys = serial ? "rejector.device and rejector.baud" : "rejector.host and rejector.port";
    if (context_->modbus == nullptr)
        return fail(ErrorCode::io, "no Modbus context for the rejector at " + name(), std::string("check ") + keys);
    modbus_set_slave(context_->modbus, address_.unit);
    wait_at_most(timeout);
    int error = 0;
    if (modbus_connect(context_->modbus) != 0) error = errno;
    if (error == 0 && serial && serial->rs485 && modbus_rtu_set_serial_mode(context_->modbus, MODBUS_RTU_RS485) != 0)
        error = errno;
    if (error == 0) {
        connected_ = true;
        if (serial) discard(gap_, timeout);  // bytes from before
        return {};
    }
    context_.reset();
    if (serial) {
        const bool absent = error == ENOENT || error == ENODEV || error == ENXIO;
        return fail(absent ? ErrorCode::not_found : ErrorCode::io,
                    "the rejector's serial line " + serial->device + " cannot be opened: " + std::strerror(error),
                    error == EACCES ? "join the group dialout"
                                    : "check the adapter, rejector.device, and whether rejector.rs485 fits it");
    }
    const bool unanswered = error == ETIMEDOUT || error == EINPROGRESS;
    return fail(unanswered ? ErrorCode::timeout : ErrorCode::disconnected,
                "the rejector module at " + name() +
                    (unanswered ? " does not answer" : std::string(" cannot be reached: ") + modbus_strerror(error)),
                std::string("check its power and cable, ") + keys);
}

void CoilLink::close() {
    context_.reset();
    connected_ = false;
}

tl::unexpected<Error> CoilLink::failed(const std::string& what, int error) {
    if (is_exception(error)) {
        return fail(ErrorCode::refused, what + ": " + modbus_strerror(error),
                    "check the address and the module's own fault display");
    }
    close();
    return fail(error == ETIMEDOUT ? ErrorCode::timeout : ErrorCode::disconnected, what + ": " + modbus_strerror(error),
                "check the module's power and cable; the driver keeps trying");
}

void CoilLink::keep_gap() const {
    const Duration left = last_byte_ + gap_ - clock_.now();
    if (left > 0ns) std::this_thread::sleep_for(left);
}

// Discards bytes until none arrived for `silence`, for `longest` at most.
void CoilLink::discard(Duration silence, Duration longest) {
    const hal::TimePoint end = std::min(clock_.now() + longest, give_up_);
    std::array<std::uint8_t, 256> bytes{};
    for (hal::TimePoint at = clock_.now(); at < end; at = clock_.now()) {
        pollfd ready{modbus_get_socket(context_->modbus), POLLIN, 0};
        const Duration wait = std::min(silence, end - at);
        const timespec until{wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
        if (ppoll(&ready, 1, &until, nullptr) <= 0) break;
        if (::read(ready.fd, bytes.data(), bytes.size()) <= 0) break;
    }
    last_byte_ = clock_.now();
}

// One request and its answer. A serial line can be used again afterwards, also after an error.
template <class Request>
Result<void> CoilLink::exchange(const std::string& what, Duration timeout, Again again, Request request) {
    if (!connected_) return failed(what, ENOTCONN);
    for (int attempt = 0;; ++attempt) {
        if (address_.serial) {
            keep_gap();
            modbus_flush(context_->modbus);
        }
        const hal::TimePoint from = clock_.now();
        wait_at_most(timeout);
        const bool done = request(context_->modbus);
        const int error = done ? 0 : errno;
        last_byte_ = clock_.now();
        if (done || is_exception(error)) {
            typical_response_ = std::max(last_byte_ - from, typical_response_ - typical_response_ / 8);
            return done ? Result<void>{} : failed(what, error);
        }
        const bool damaged = is_damage(error);
        if (!address_.serial || (!damaged && error != ETIMEDOUT)) return failed(what, error);
        discard(damaged ? gap_ : timeout, timeout);
        if (again == Again::no) {
            return fail(ErrorCode::io, what + ": " + modbus_strerror(error),
                        "check the line's cable, termination and shield");
        }
        if (attempt == 1) return failed(what, error);
    }
}

Result<bool> CoilLink::read(int coil, Duration timeout) {
    std::uint8_t value = 0;
    auto done = exchange(which("coil", coil) + " cannot be read", timeout, Again::yes,
                         [&](modbus_t* m) { return modbus_read_bits(m, coil, 1, &value) == 1; });
    if (!done) return tl::unexpected(done.error());
    return value != 0;
}

Result<bool> CoilLink::read_input(int number, Duration timeout) {
    std::uint8_t value = 0;
    auto done = exchange(which("input", number) + " cannot be read", timeout, Again::yes,
                         [&](modbus_t* m) { return modbus_read_input_bits(m, number, 1, &value) == 1; });
    if (!done) return tl::unexpected(done.error());
    return value != 0;
}

Result<void> CoilLink::write_register(int number, int value, Duration timeout) {
    return exchange(which("register", number) + " cannot be written", timeout, Again::yes, [&](modbus_t* m) {
        return modbus_write_register(m, number, static_cast<std::uint16_t>(value)) == 1;
    });
}

Result<std::uint16_t> CoilLink::read_register(int number, Duration timeout) {
    std::uint16_t value = 0;
    auto done = exchange(which("register", number) + " cannot be read", timeout, Again::yes,
                         [&](modbus_t* m) { return modbus_read_registers(m, number, 1, &value) == 1; });
    if (!done) return tl::unexpected(done.error());
    return value;
}

Result<std::vector<std::uint16_t>> CoilLink::read_input_registers(int number, int count, Duration timeout) {
    std::vector<std::uint16_t> values(static_cast<std::size_t>(count));
    auto done = exchange(which("input register", number) + " cannot be read", timeout, Again::yes, [&](modbus_t* m) {
        return modbus_read_input_registers(m, number, count, values.data()) == count;
    });
    if (!done) return tl::unexpected(done.error());
    return values;
}

Result<void> CoilLink::write_coil(const std::string& what, int coil, bool on, int read_at, Duration timeout,
                                  bool must_read_back) {
    const hal::TimePoint by = clock_.now() + timeout;
    const auto written =
        exchange(what, timeout, Again::no, [&](modbus_t* m) { return modbus_write_bit(m, coil, on ? 1 : 0) == 1; });
    if (!written && (!connected_ || written.error().code == ErrorCode::refused)) return written;
    acknowledged_ = clock_.now();
    if (written && !must_read_back) return {};
    std::uint8_t value = 0;
    const auto read_it = [&](modbus_t* m) { return modbus_read_bits(m, read_at, 1, &value) == 1; };
    const auto back =
        exchange(which("coil", read_at) + " cannot be read back", address_.serial ? timeout : by - clock_.now(),
                 written ? Again::yes : Again::no, read_it);
    if (!back && !written && connected_ && back.error().code == ErrorCode::io)
        return failed(what, ETIMEDOUT);  // no answer to the read either
    if (!back) return back;
    if (!written) acknowledged_ = clock_.now();
    if ((value != 0) == on) return {};
    if (!written) return written;
    return fail(ErrorCode::refused, which("coil", coil) + " does not read back as written",
                "check that nothing else writes it, that the output is not forced, and rejector.profile");
}

Result<void> CoilLink::write(int coil, bool on, int read_at, Duration timeout) {
    return write_coil(which("coil", coil) + " cannot be written", coil, on, read_at, timeout, true);
}

Result<void> CoilLink::command(int coil, bool on, Duration timeout) {
    return write_coil(which("coil", coil) + " cannot be written", coil, on, coil, timeout, false);
}

Result<std::string> CoilLink::identify(Duration timeout) {
    const std::string what = "the rejector module at " + name();
    if (!connected_) return failed(what + " cannot be asked what it is", ENOTCONN);
    if (address_.serial) keep_gap();
    modbus_flush(context_->modbus);
    const std::array<std::uint8_t, 5> request{static_cast<std::uint8_t>(address_.unit), 43, 14, 1, 0};
    // libmodbus cannot parse this answer: it is read here until its end or a pause.
    std::vector<std::uint8_t> answer;
    const std::size_t head = address_.serial ? 1 : 7;
    if (modbus_send_raw_request(context_->modbus, request.data(), static_cast<int>(request.size())) > 0) {
        const hal::TimePoint end = clock_.now() + timeout;
        for (hal::TimePoint at = clock_.now(); at < end && answer.size() < 260; at = clock_.now()) {
            const bool complete = address_.serial
                ? false
                : answer.size() >= 6 && answer.size() >= 6U + static_cast<std::size_t>(answer[4] << 8 | answer[5]);
            if (complete) break;
            pollfd ready{modbus_get_socket(context_->modbus), POLLIN, 0};
            const Duration wait = address_.serial && !answer.empty() ? std::min<Duration>(end - at, 20ms) : end - at;
            const timespec until{wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
            if (ppoll(&ready, 1, &until, nullptr) <= 0) break;
            std::array<std::uint8_t, 260> bytes{};
            const ssize_t count = ::read(ready.fd, bytes.data(), bytes.size());
            if (count <= 0) break;
            answer.insert(answer.end(), bytes.begin(), bytes.begin() + count);
        }
    }
    close();
    if (answer.size() < head + 2) return fail(ErrorCode::timeout, what + " does not say what it is", "see its label");
    if (answer[head] != 43 || answer.size() < head + 7)
        return fail(ErrorCode::unsupported, what + " has no device identification", "see its label");
    std::string text;
    std::size_t at = head + 7;
    for (int left = answer[head + 6]; left > 0 && at + 2 <= answer.size(); --left) {
        const std::size_t size = std::min<std::size_t>(answer[at + 1], answer.size() - at - 2);
        if (!text.empty()) text += ' ';
        for (std::size_t k = 0; k < size; ++k) {
            const auto letter = answer[at + 2 + k];
            text += letter >= 0x20 && letter < 0x7F ? static_cast<char>(letter) : '?';
        }
        at += 2 + size;
    }
    return text;
}

}  // namespace hord::drivers
