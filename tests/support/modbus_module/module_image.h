// The state of a Modbus module: coils, inputs, registers, pulses and watchdog. Pure: requests and times in, replies
// out. Written from the vendors' manuals, independently of the driver, to reveal a wrong address.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "drivers/hal/clock.h"

namespace hord::test {

enum class ModuleKind : std::uint8_t {
    plain,  // coils and discrete inputs from 0 on, device identification (function 43/14)
    wago,   // 750: coils read back at 0x200 + n (at n, the inputs are read), watchdog registers from 0x1000 on
    moxa,   // ioLogik E1200: pulses by coil 16 + n, a watchdog that raises an alarm in coil 4144, its name from input
            // register 5000 on
    adam,   // ADAM-6050: coils 0..11 read the inputs, coil 16 + n is output n; no registers, no device identification
};

class ModuleImage {
  public:
    // `pulse`: width of a pulse coil's pulse (moxa). `watchdog`: moxa's own, from the first request on; zero: none.
    ModuleImage(ModuleKind kind, int coils, hal::Duration pulse, hal::Duration watchdog);

    // Called whenever an output moves.
    std::function<void(int coil, bool on, hal::TimePoint at)> moved;

    // The reply to one request (function code and data); an exception where the module refuses.
    std::vector<std::uint8_t> answer(std::span<const std::uint8_t> pdu, hal::TimePoint now);

    // Ends the pulses and expires the watchdog that are due by `now`.
    void advance(hal::TimePoint now);
    [[nodiscard]] hal::TimePoint next() const;  // when advance() is due next; max: never

    void set_input(int number, bool on) { inputs_.at(static_cast<std::size_t>(number)) = on; }
    void move(int coil, bool on, hal::TimePoint at);
    void power_off(hal::TimePoint at);  // outputs fall, registers are reset
    [[nodiscard]] bool coil(int number) const { return coils_.at(static_cast<std::size_t>(number)); }
    [[nodiscard]] bool watchdog_expired() const { return expired_; }
    [[nodiscard]] int triggers() const { return triggers_; }  // of the watchdog, since the start

  private:
    std::vector<std::uint8_t> read_bits(std::span<const std::uint8_t> pdu, bool coils) const;
    std::vector<std::uint8_t> read_registers(std::span<const std::uint8_t> pdu, bool holding) const;
    std::vector<std::uint8_t> write_coil(std::span<const std::uint8_t> pdu, hal::TimePoint now);
    std::vector<std::uint8_t> write_register(std::span<const std::uint8_t> pdu, hal::TimePoint now);
    std::vector<std::uint8_t> identify(std::span<const std::uint8_t> pdu) const;
    [[nodiscard]] int bit_at(int address, bool coils) const;  // -1: no such address
    void trigger(hal::TimePoint now);
    void outputs_off(hal::TimePoint at);

    const ModuleKind kind_;
    const hal::Duration pulse_, moxa_watchdog_;
    std::vector<bool> coils_, inputs_;
    std::vector<hal::TimePoint> pulse_ends_;  // by coil; max: none
    std::uint16_t watchdog_time_ = 0, trigger_value_ = 0;
    bool running_ = false, expired_ = false;
    hal::TimePoint expires_ = hal::TimePoint::max();
    int triggers_ = 0;
};

}  // namespace hord::test
