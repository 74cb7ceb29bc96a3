#include "drivers/modbus/coil_link.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <thread>

#include <modbus/modbus.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/crc16.h"
#include "common/tcp_listener.h"

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

constexpr const char* kLine = "the line's cable, termination and shield";
constexpr const char* kSerialCure =
    "check rejector.baud, rejector.parity and rejector.unit against the module's settings; then the line's cable, "
    "termination and shield";

}  // namespace

void CoilLink::CloseContext::operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
}

CoilLink::CoilLink(const hal::Clock& clock, ModuleAddress address, Duration response_timeout)
    : clock_(clock), address_(std::move(address)), timeout_(response_timeout), gap_(frame_gap(address_)) {}

std::string CoilLink::name() const {
    if (address_.serial) return address_.serial->device + " unit " + std::to_string(address_.unit);
    return address_.host_and_port();
}
std::string CoilLink::which(const char* thing, int number) const {
    return std::string(thing) + " " + std::to_string(number) + " of the rejector module at " + name();
}

void CoilLink::limit_wait(Duration timeout) {
    if (give_up_ != hal::TimePoint::max()) timeout = std::min(timeout, give_up_ - clock_.now());
    const auto us =
        std::max<std::int64_t>(1000, std::chrono::duration_cast<std::chrono::microseconds>(timeout).count());
    modbus_set_response_timeout(context_.get(), static_cast<std::uint32_t>(us / 1000000),
                                static_cast<std::uint32_t>(us % 1000000));
    // Without a time-out between bytes the one above limits the whole answer, also of a module that sends slowly.
    modbus_set_byte_timeout(context_.get(), 0, 0);
}

Result<void> CoilLink::connect() {
    close();
    const auto& serial = address_.serial;
    context_.reset(
        serial ? modbus_new_rtu(serial->device.c_str(), serial->baud, serial->parity, 8, serial->parity == 'N' ? 2 : 1)
               : modbus_new_tcp_pi(address_.host.c_str(), std::to_string(address_.port).c_str()));
    const char* keys = serial ? "rejector.device and rejector.baud" : "rejector.host and rejector.port";
    if (!context_)
        return fail(ErrorCode::io, "no Modbus context for the rejector at " + name(), std::string("check ") + keys);
    modbus_set_slave(context_.get(), address_.unit);
    limit_wait(timeout_);
    int error = 0;
    if (modbus_connect(context_.get()) != 0) error = errno;
    if (error == 0 && serial && serial->rs485 && modbus_rtu_set_serial_mode(context_.get(), MODBUS_RTU_RS485) != 0)
        error = errno;
    if (error == 0) {
        connected_ = true;
        if (serial) discard(gap_);  // bytes of an earlier answer
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
    if (const std::string unknown = common::resolve_problem(address_.host); !unknown.empty())
        return fail(ErrorCode::disconnected, "the rejector module at " + name() + " cannot be reached: " + unknown,
                    "check rejector.host");
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
    const std::string said = what + ": " + modbus_strerror(error);
    switch (error) {
        case EMBXILFUN:
        case EMBXILADD:
        case EMBXILVAL:
            return fail(
                ErrorCode::refused, said + " (the module answers and has no such output or register)",
                "check rejector.unit, rejector.profile and the coils and registers in [rejector]" + how_to_ask());
        case EMBXGPATH:
        case EMBXGTAR:
            return fail(ErrorCode::refused, said + " (a gateway answers, not the module behind it)",
                        "check rejector.unit, and the module's power and cable behind the gateway");
        default: break;
    }
    if (is_exception(error)) return fail(ErrorCode::refused, said, "check the module's own fault display");
    close();
    if (is_damage(error) && !of_another_.empty())
        return fail(ErrorCode::disconnected, what + ": " + of_another_,
                    "check rejector.unit and what stands between the station and the module, such as a gateway");
    if (is_damage(error) && address_.serial)
        return fail(ErrorCode::disconnected, said + " (the answer is damaged or none of Modbus)", kSerialCure);
    if (is_damage(error))
        return fail(ErrorCode::disconnected, said + " (the answer is none of Modbus)",
                    std::string("is the rejector's module really at ") + name() +
                        "? Check rejector.host, rejector.port and "
                        "rejector.unit" +
                        how_to_ask());
    if (error == ECONNRESET)
        return fail(ErrorCode::disconnected, said,
                    "check the module's power, how many connections it accepts, and that the rejector's module is "
                    "really at " +
                        name() + "; the driver keeps trying");
    if (error == ETIMEDOUT)
        return fail(
            ErrorCode::timeout, what + ": no answer within " + std::to_string(timeout_ / 1ms) + " ms",
            "check the module's power and cable, rejector.unit and rejector.response_timeout_ms; the driver keeps "
            "trying");
    return fail(ErrorCode::disconnected, said, "check the module's power and cable; the driver keeps trying");
}

std::string CoilLink::how_to_ask() const {
    return address_.serial ? "" : "; hordctl devices --module " + name() + " asks it what it is";
}

void CoilLink::keep_gap() const {
    const Duration left = last_byte_ + gap_ - clock_.now();
    if (left > 0ns) std::this_thread::sleep_for(left);
}

// Reads the available bytes. 0: none arrived within `wait`, or the line is gone.
std::size_t CoilLink::read_bytes(std::span<std::uint8_t> bytes, Duration wait) const {
    pollfd ready{modbus_get_socket(context_.get()), POLLIN, 0};
    const timespec until{wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
    if (ppoll(&ready, 1, &until, nullptr) <= 0) return 0;
    return static_cast<std::size_t>(std::max<ssize_t>(0, ::read(ready.fd, bytes.data(), bytes.size())));
}

// Discards bytes until none arrived for `silence`, for the response time-out at most.
void CoilLink::discard(Duration silence) {
    const hal::TimePoint end = std::min(clock_.now() + timeout_, give_up_);
    std::array<std::uint8_t, 256> bytes{};
    for (hal::TimePoint at = clock_.now(); at < end; at = clock_.now()) {
        if (read_bytes(bytes, std::min(silence, end - at)) == 0) break;
    }
    last_byte_ = clock_.now();
}

// Sends a request of a function whose parameters are an address and a value or count, and copies the data of its
// answer. libmodbus compares neither the unit of an answer over TCP nor the address that a write echoes: done here.
// False: errno says why.
bool CoilLink::ask(int function, int number, int value, std::span<std::uint8_t> data) {
    const auto byte = [](int word, int shift) { return static_cast<std::uint8_t>(word >> shift); };
    const auto wrong = [](int error) { return errno = error, false; };
    ++transaction_;
    const std::array<std::uint8_t, 12> request{byte(transaction_, 8),
                                               byte(transaction_, 0),
                                               0,
                                               0,
                                               0,
                                               6,
                                               byte(address_.unit, 0),
                                               byte(function, 0),
                                               byte(number, 8),
                                               byte(number, 0),
                                               byte(value, 8),
                                               byte(value, 0)};
    constexpr std::size_t kTcpHead = 6;
    of_another_.clear();
    if (address_.serial) {
        if (modbus_send_raw_request(context_.get(), request.data() + kTcpHead, 6) < 0) return false;
    } else if (const auto sent =
                   ::send(modbus_get_socket(context_.get()), request.data(), request.size(), MSG_NOSIGNAL);
               sent != static_cast<ssize_t>(request.size())) {
        return sent < 0 ? false : wrong(EIO);
    }
    std::array<std::uint8_t, MODBUS_MAX_ADU_LENGTH> answer{};
    const int count = modbus_receive_confirmation(context_.get(), answer.data());
    if (count < 0) return false;
    const std::size_t head = address_.serial ? 0 : kTcpHead;
    if (!address_.serial && !std::equal(answer.begin(), answer.begin() + 4, request.begin())) return wrong(EMBBADDATA);
    if (answer[head] != request[kTcpHead]) {
        of_another_ = "unit " + std::to_string(answer[head]) + " answers, not unit " + std::to_string(address_.unit);
        return wrong(EMBBADSLAVE);
    }
    const std::span<const std::uint8_t> pdu(answer.data() + head + 1, answer.size() - head - 1);
    if (pdu[0] == (function | 0x80))
        return wrong(pdu[1] > 0 && pdu[1] < MODBUS_EXCEPTION_MAX ? MODBUS_ENOBASE + pdu[1] : EMBBADEXC);
    if (pdu[0] != function) return wrong(EMBBADDATA);
    if (data.empty()) {
        const int echoed = pdu[1] << 8 | pdu[2];
        if (echoed == number) return true;
        of_another_ = "the answer acknowledges address " + std::to_string(echoed) + ", not " + std::to_string(number);
        return wrong(EMBBADDATA);
    }
    if (pdu[1] != data.size()) return wrong(EMBBADDATA);
    std::copy_n(pdu.begin() + 2, data.size(), data.begin());
    return true;
}

// One request and its answer. A serial line can be used again afterwards, also after an error.
template <class Request>
Result<void> CoilLink::exchange(const std::string& what, Again again, Request request, Duration timeout) {
    if (!connected_) return failed(what, ENOTCONN);
    for (int attempt = 0;; ++attempt) {
        if (address_.serial) {
            keep_gap();
            modbus_flush(context_.get());
        }
        const hal::TimePoint from = clock_.now();
        limit_wait(timeout);
        const bool done = request();
        const int error = done ? 0 : errno;
        last_byte_ = clock_.now();
        if (done || is_exception(error)) {
            typical_response_ = std::max(last_byte_ - from, typical_response_ - typical_response_ / 8);
            return done ? Result<void>{} : failed(what, error);
        }
        const bool damaged = is_damage(error);
        if (!address_.serial || (!damaged && error != ETIMEDOUT)) return failed(what, error);
        discard(damaged ? gap_ : timeout);
        if (again == Again::no) {
            return fail(ErrorCode::io, what + ": " + modbus_strerror(error), std::string("check ") + kLine);
        }
        if (attempt == 1) return failed(what, error);
    }
}

Result<bool> CoilLink::read_bit(const char* thing, int number, int function) {
    std::array<std::uint8_t, 1> value{};
    return exchange(which(thing, number) + " cannot be read", Again::yes,
                    [&] { return ask(function, number, 1, value); })
        .map([&] { return (value[0] & 1) != 0; });
}

Result<bool> CoilLink::read(int coil) { return read_bit("coil", coil, MODBUS_FC_READ_COILS); }

Result<bool> CoilLink::read_input(int number) { return read_bit("input", number, MODBUS_FC_READ_DISCRETE_INPUTS); }

Result<std::vector<std::uint16_t>> CoilLink::read_registers(RegisterKind kind, int number, int count) {
    const bool input = kind == RegisterKind::input;
    std::vector<std::uint8_t> bytes(2 * static_cast<std::size_t>(count));
    return exchange(which(input ? "input register" : "register", number) + " cannot be read", Again::yes,
                    [&] {
                        return ask(input ? MODBUS_FC_READ_INPUT_REGISTERS : MODBUS_FC_READ_HOLDING_REGISTERS, number,
                                   count, bytes);
                    })
        .map([&] {
            std::vector<std::uint16_t> values;
            for (std::size_t k = 0; k < bytes.size(); k += 2)
                values.push_back(static_cast<std::uint16_t>(bytes[k] << 8 | bytes[k + 1]));
            return values;
        });
}

Result<void> CoilLink::write_register(int number, int value) {
    return exchange(which("register", number) + " cannot be written", Again::yes,
                    [&] { return ask(MODBUS_FC_WRITE_SINGLE_REGISTER, number, value, {}); });
}

Result<void> CoilLink::write(int coil, bool on, std::optional<int> read_at) {
    const std::string what = which("coil", coil) + " cannot be written";
    const hal::TimePoint from = clock_.now(), by = from + timeout_;
    const auto written =
        exchange(what, Again::no, [&] { return ask(MODBUS_FC_WRITE_SINGLE_COIL, coil, on ? 0xFF00 : 0, {}); });
    if (!written && (!connected_ || written.error().code == ErrorCode::refused)) return written;
    acknowledged_ = clock_.now();
    if (written && !read_at) return {};
    const int back_at = read_at.value_or(coil);
    std::array<std::uint8_t, 1> value{};
    auto back = exchange(
        which("coil", back_at) + " cannot be read back", written ? Again::yes : Again::no,
        [&] { return ask(MODBUS_FC_READ_COILS, back_at, 1, value); }, address_.serial ? timeout_ : by - clock_.now());
    if (!back && !address_.serial && back.error().code == ErrorCode::timeout)
        back.error().what +=
            " for the write (" + std::to_string((acknowledged_ - from) / 1ms) + " ms) and its reading back together";
    if (!back && !written && connected_ && back.error().code == ErrorCode::io)
        return failed(what, ETIMEDOUT);  // no answer to the read either
    if (!back) return back;
    if (!written) acknowledged_ = clock_.now();
    if (((value[0] & 1) != 0) == on) return {};
    if (!written) return written;
    return fail(
        ErrorCode::refused,
        which("coil", coil) + " answered, but reads back " + (on ? "0" : "1") + " where " + (on ? "1" : "0") +
            " was written" + (back_at == coil ? "" : " (it is read at coil " + std::to_string(back_at) + ")"),
        "check rejector.profile, that nothing else writes the coil, and that the output is not forced" + how_to_ask());
}

Result<std::string> CoilLink::identify() {
    const std::string what = "the rejector module at " + name();
    if (!connected_) return failed(what + " cannot be asked what it is", ENOTCONN);
    if (address_.serial) keep_gap();
    modbus_flush(context_.get());
    const std::array<std::uint8_t, 5> request{static_cast<std::uint8_t>(address_.unit), 43, 14, 1, 0};
    // libmodbus cannot parse this answer: it is read here until its end or a pause.
    std::vector<std::uint8_t> answer;
    bool in_time = false;
    const std::size_t head = address_.serial ? 1 : 7;
    if (modbus_send_raw_request(context_.get(), request.data(), static_cast<int>(request.size())) > 0) {
        const hal::TimePoint end = clock_.now() + timeout_;
        for (hal::TimePoint at = clock_.now(); at < end && answer.size() < 260; at = clock_.now()) {
            // A TCP answer contains its length; a serial one ends with its checksum and a pause.
            if (!address_.serial && answer.size() >= 6 &&
                answer.size() >= 6U + static_cast<std::size_t>(answer[4] << 8 | answer[5]))
                break;
            std::array<std::uint8_t, 260> bytes{};
            const std::size_t count = read_bytes(
                bytes,
                address_.serial && common::ends_with_crc16(answer) ? std::min<Duration>(end - at, 20ms) : end - at);
            if (count == 0) break;
            answer.insert(answer.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
        }
        in_time = clock_.now() < end;
    }
    close();
    if (answer.empty())
        return fail(ErrorCode::timeout,
                    what + (in_time ? " closes the connection without an answer" : " does not answer") + " as unit " +
                        std::to_string(address_.unit),
                    "check the unit, that no other program holds the module, and that the address is the module's");
    if (address_.serial && !common::ends_with_crc16(answer))
        return fail(ErrorCode::unreadable, what + " answers, and the answer is damaged or none of Modbus", kSerialCure);
    if (answer.size() < head + 2) return fail(ErrorCode::timeout, what + " does not say what it is", "see its label");
    constexpr int kRefused = 43 | 0x80;
    const bool described = answer[head] == 43 && answer[head + 1] == 14 && answer.size() >= head + 7;
    const bool of_modbus = address_.serial || (answer[2] == 0 && answer[3] == 0);
    if (!of_modbus || (answer[head] != kRefused && !described))
        return fail(ErrorCode::unreadable, what + " answers, and not as a Modbus module does",
                    "check its address and port: modules listen on port 502");
    if (answer[head - 1] != address_.unit)
        return fail(ErrorCode::refused,
                    what + " answers as unit " + std::to_string(answer[head - 1]) + ", not as unit " +
                        std::to_string(address_.unit),
                    "give that unit");
    const int code = described ? 0 : answer[head + 1];
    if (code == MODBUS_EXCEPTION_GATEWAY_PATH || code == MODBUS_EXCEPTION_GATEWAY_TARGET)
        return fail(ErrorCode::refused,
                    what + " does not answer: a gateway does, in its place, for unit " + std::to_string(address_.unit),
                    "check the unit, and the module's power and cable behind the gateway");
    if (!described) return fail(ErrorCode::unsupported, what + " has no device identification", "see its label");
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
