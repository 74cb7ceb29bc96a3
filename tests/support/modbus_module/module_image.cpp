#include "tests/support/modbus_module/module_image.h"

#include <algorithm>
#include <string_view>

namespace hord::test {
namespace {

using Bytes = std::vector<std::uint8_t>;
using hal::TimePoint;

constexpr int kIllegalFunction = 1, kIllegalAddress = 2, kIllegalValue = 3, kDeviceFailure = 4;
constexpr int kInputs = 64;
constexpr int kWagoReadBack = 0x200, kWagoTime = 0x1000, kWagoTrigger = 0x1003, kWagoStatus = 0x1006,
              kWagoStop = 0x1008, kWagoItem = 0x2012;
constexpr int kWagoItemNumber = 352;
constexpr int kMoxaPulse = 16, kMoxaAlarm = 4144, kMoxaName = 5000, kMoxaNameWords = 10;
constexpr std::string_view kMoxaModel = "E1213";
constexpr int kAdamOutputs = 16, kAdamInputs = 12;
constexpr auto kWagoUnit = std::chrono::milliseconds(100);

int word(std::span<const std::uint8_t> bytes, std::size_t at) { return bytes[at] << 8 | bytes[at + 1]; }
Bytes exception(std::uint8_t function, int code) {
    return {static_cast<std::uint8_t>(function | 0x80), static_cast<std::uint8_t>(code)};
}

}  // namespace

ModuleImage::ModuleImage(ModuleKind kind, int coils, hal::Duration pulse, hal::Duration watchdog)
    : kind_(kind), pulse_(pulse), moxa_watchdog_(watchdog), coils_(static_cast<std::size_t>(coils)), inputs_(kInputs),
      pulse_ends_(static_cast<std::size_t>(coils), TimePoint::max()) {}

void ModuleImage::move(int coil, bool on, TimePoint at) {
    const auto index = static_cast<std::size_t>(coil);
    if (coils_[index] == on) return;
    coils_[index] = on;
    if (moved) moved(coil, on, at);
}

void ModuleImage::outputs_off(TimePoint at) {
    std::ranges::fill(pulse_ends_, TimePoint::max());
    for (int coil = 0; coil < static_cast<int>(coils_.size()); ++coil) move(coil, false, at);
}

void ModuleImage::power_off(TimePoint at) {
    outputs_off(at);
    watchdog_time_ = trigger_value_ = 0;
    running_ = expired_ = false;
    expires_ = TimePoint::max();
}

TimePoint ModuleImage::next() const { return std::min(expires_, *std::ranges::min_element(pulse_ends_)); }

void ModuleImage::advance(TimePoint now) {
    for (std::size_t k = 0; k < coils_.size(); ++k) {
        if (pulse_ends_[k] > now) continue;
        move(static_cast<int>(k), false, pulse_ends_[k]);
        pulse_ends_[k] = TimePoint::max();
    }
    if (expires_ > now) return;
    expires_ = TimePoint::max();
    running_ = false;
    expired_ = true;
    outputs_off(now);
}

void ModuleImage::trigger(TimePoint now) {
    ++triggers_;
    if (kind_ == ModuleKind::wago && watchdog_time_ > 0) {
        running_ = true;
        expired_ = false;
        expires_ = now + watchdog_time_ * kWagoUnit;
    } else if (kind_ == ModuleKind::moxa && moxa_watchdog_ > hal::Duration::zero() && !expired_) {
        running_ = true;
        expires_ = now + moxa_watchdog_;
    }
}

Bytes ModuleImage::answer(std::span<const std::uint8_t> pdu, TimePoint now) {
    advance(now);
    if (pdu.empty()) return {};
    if (kind_ == ModuleKind::moxa) trigger(now);  // any request of the host
    const std::uint8_t function = pdu[0];
    if (function == 43) return identify(pdu);
    const bool known = function >= 1 && function <= 6;
    if (!known) return exception(function, kIllegalFunction);
    if (pdu.size() != 5) return exception(function, kIllegalValue);
    switch (function) {
        case 1: return read_bits(pdu, true);
        case 2: return read_bits(pdu, false);
        case 3: return read_registers(pdu, true);
        case 4: return read_registers(pdu, false);
        case 5: return write_coil(pdu, now);
        default: return write_register(pdu, now);
    }
}

int ModuleImage::bit_at(int address, bool coils) const {
    const int outputs = static_cast<int>(coils_.size());
    const auto output = [&](int k) { return k >= 0 && k < outputs ? int{coils_[static_cast<std::size_t>(k)]} : -1; };
    const auto input = [&](int k) { return k < kInputs ? int{inputs_[static_cast<std::size_t>(k)]} : -1; };
    switch (kind_) {
        case ModuleKind::plain: return coils ? output(address) : input(address);
        case ModuleKind::wago: return address >= kWagoReadBack ? output(address - kWagoReadBack) : input(address);
        case ModuleKind::adam:
            if (coils && address >= kAdamOutputs) return output(address - kAdamOutputs);
            return address < kAdamInputs ? input(address) : -1;
        case ModuleKind::moxa: break;
    }
    if (!coils) return input(address);
    if (address == kMoxaAlarm) return expired_ ? 1 : 0;
    if (address >= kMoxaPulse && address < kMoxaPulse + std::min(outputs, 16)) {
        return pulse_ends_[static_cast<std::size_t>(address - kMoxaPulse)] != TimePoint::max() ? 1 : 0;
    }
    return address < 16 ? output(address) : -1;
}

Bytes ModuleImage::read_bits(std::span<const std::uint8_t> pdu, bool coils) const {
    const int address = word(pdu, 1), count = word(pdu, 3);
    if (count < 1 || count > 2000) return exception(pdu[0], kIllegalValue);
    Bytes reply{pdu[0], static_cast<std::uint8_t>((count + 7) / 8)};
    reply.resize(2 + reply[1], 0);
    for (int k = 0; k < count; ++k) {
        const int bit = bit_at(address + k, coils);
        if (bit < 0) return exception(pdu[0], kIllegalAddress);
        reply[static_cast<std::size_t>(2 + k / 8)] |= static_cast<std::uint8_t>(bit << k % 8);
    }
    return reply;
}

Bytes ModuleImage::read_registers(std::span<const std::uint8_t> pdu, bool holding) const {
    const int address = word(pdu, 1), count = word(pdu, 3);
    if (count < 1 || count > 125) return exception(pdu[0], kIllegalValue);
    Bytes reply{pdu[0], static_cast<std::uint8_t>(2 * count)};
    for (int at = address; at < address + count; ++at) {
        int value = -1;
        if (kind_ == ModuleKind::wago) {
            if (at == kWagoTime) value = watchdog_time_;
            if (at == kWagoTrigger) value = trigger_value_;
            if (at == kWagoStatus) value = expired_ ? 2 : running_ ? 1 : 0;
            if (at == kWagoItem) value = kWagoItemNumber;
        } else if (kind_ == ModuleKind::moxa && !holding && at >= kMoxaName && at < kMoxaName + kMoxaNameWords) {
            const auto letter = [&](int k) {
                return k < static_cast<int>(kMoxaModel.size()) ? kMoxaModel[static_cast<std::size_t>(k)] : '\0';
            };
            value = letter(2 * (at - kMoxaName)) << 8 | letter(2 * (at - kMoxaName) + 1);
        }
        if (value < 0) return exception(pdu[0], kIllegalAddress);
        reply.push_back(static_cast<std::uint8_t>(value >> 8));
        reply.push_back(static_cast<std::uint8_t>(value & 0xFF));
    }
    return reply;
}

Bytes ModuleImage::write_coil(std::span<const std::uint8_t> pdu, TimePoint now) {
    int address = word(pdu, 1);
    const int value = word(pdu, 3);
    if (value != 0 && value != 0xFF00) return exception(pdu[0], kIllegalValue);
    const bool on = value != 0;
    const Bytes echo(pdu.begin(), pdu.end());
    if (kind_ == ModuleKind::moxa && address == kMoxaAlarm) {
        if (on) expired_ = false;
        trigger(now);
        return echo;
    }
    const int outputs = static_cast<int>(coils_.size());
    const bool pulse = kind_ == ModuleKind::moxa && address >= kMoxaPulse;
    if (pulse) address -= kMoxaPulse;
    if (kind_ == ModuleKind::wago && address >= kWagoReadBack) address -= kWagoReadBack;
    if (kind_ == ModuleKind::adam) {
        if (address < kAdamOutputs) return exception(pdu[0], kIllegalAddress);  // an input
        address -= kAdamOutputs;
    }
    if (address >= outputs || (kind_ == ModuleKind::moxa && address >= 16)) return exception(pdu[0], kIllegalAddress);
    if (expired_) return exception(pdu[0], kDeviceFailure);  // until the expired watchdog is reset
    if (pulse) pulse_ends_[static_cast<std::size_t>(address)] = on ? now + pulse_ : TimePoint::max();
    move(address, on, now);
    return echo;
}

Bytes ModuleImage::write_register(std::span<const std::uint8_t> pdu, TimePoint now) {
    const int address = word(pdu, 1), value = word(pdu, 3);
    if (kind_ != ModuleKind::wago) return exception(pdu[0], kIllegalAddress);
    switch (address) {
        case kWagoTime:
            if (running_) return exception(pdu[0], kIllegalValue);  // not while it runs
            watchdog_time_ = static_cast<std::uint16_t>(value);
            break;
        case kWagoTrigger:
            if (value != trigger_value_ && value != 0) trigger(now);
            trigger_value_ = static_cast<std::uint16_t>(value);
            break;
        case kWagoStop:
            if (value != 0xAA55 && value != 0x55AA) return exception(pdu[0], kIllegalValue);
            running_ = expired_ = false;
            expires_ = TimePoint::max();
            break;
        default: return exception(pdu[0], kIllegalAddress);
    }
    return {pdu.begin(), pdu.end()};
}

// Read Device Identification, basic, as a stream.
Bytes ModuleImage::identify(std::span<const std::uint8_t> pdu) const {
    if (kind_ != ModuleKind::plain) return exception(43, kIllegalFunction);
    if (pdu.size() != 4 || pdu[1] != 14 || pdu[2] != 1) return exception(43, kIllegalValue);
    Bytes reply{43, 14, 1, 1, 0, 0, 3};
    constexpr std::array<std::string_view, 3> texts{"HORD", "coil module", "1.0"};
    for (std::size_t k = 0; k < texts.size(); ++k) {
        reply.push_back(static_cast<std::uint8_t>(k));
        reply.push_back(static_cast<std::uint8_t>(texts[k].size()));
        reply.insert(reply.end(), texts[k].begin(), texts[k].end());
    }
    return reply;
}

}  // namespace hord::test
