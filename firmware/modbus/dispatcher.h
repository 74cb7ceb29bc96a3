// Answers Modbus requests from a register model: PDU in, PDU out. No I/O.
//
// Function codes 1-6, 15, 16, 22, 23 and 43/14 of the Modbus Application Protocol V1.1b3. Holding and input registers
// are the same, and so are coils and discrete inputs. Exceptions: 01 unknown function, 02 address outside the map, 03
// wrong length or count.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "firmware/modbus/framer_tcp.h"

namespace hord::firmware::modbus {

enum class Exception : std::uint8_t {
    none = 0,
    illegal_function = 1,
    illegal_address = 2,
    illegal_value = 3,
    device_failure = 4,
    busy = 6,
};

// Origin of a request: its rights, and the peer that is recorded for a change.
struct Origin {
    std::string_view peer;  // "192.0.2.7:50123"
    bool may_write = true;
};

// The data behind the registers. Called by the server on the loop's thread; must not block.
class RegisterModel {
  public:
    virtual ~RegisterModel() = default;

    // Fills all of `out` from one consistent state, or returns an exception.
    virtual Exception read_registers(std::uint16_t address, std::span<std::uint16_t> out) = 0;
    virtual Exception read_bits(std::uint16_t address, std::span<bool> out);
    // Writes all of `values`, or returns an exception and writes nothing. The default refuses every address.
    virtual Exception write_registers(const Origin& origin, std::uint16_t address,
                                      std::span<const std::uint16_t> values);
    virtual Exception write_bits(const Origin& origin, std::uint16_t address, std::span<const bool> values);

    // Device identification (FC 43/14): objects 0 vendor, 1 product code, 2 revision, 3 URL, 4 product name, 5 model,
    // 6 application, from 0x80 private ones. Empty: no such object. At most 245 characters are sent.
    [[nodiscard]] virtual std::string_view identification(std::uint8_t object) const;
};

// Answers one request. Returns the reply's size, 1 <= size <= kMaxPdu. `request` has at least one byte.
std::size_t dispatch(RegisterModel& model, const Origin& origin, std::span<const std::uint8_t> request,
                     std::span<std::uint8_t, kMaxPdu> reply);

}  // namespace hord::firmware::modbus
