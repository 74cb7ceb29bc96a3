// Reads the identity of a rejector's module and the state of its outputs.
#include <algorithm>

#include <fmt/format.h>

#include "drivers/modbus/coil_link.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {
namespace {

constexpr const char* kUnknown = "a module that does not say what it is";

// From the registers named in the module map, else by Read Device Identification (function 43/14).
std::string identity_of(drivers::CoilLink& link, const drivers::ModbusRejectorOptions& options) {
    const drivers::ModuleMap& map = options.map;
    if (map.name_register >= 0) {
        using Kind = drivers::CoilLink::RegisterKind;
        const auto words = link.read_registers(map.name_words == 0 ? Kind::holding : Kind::input, map.name_register,
                                               std::max(1, map.name_words));
        if (!words) return kUnknown;
        if (map.name_words == 0) return map.name_prefix + std::to_string(words->front());
        std::string text;
        for (const std::uint16_t word : *words) {
            for (const int letter : {word >> 8, word & 0xFF}) {
                if (letter >= 0x20 && letter < 0x7F) text += static_cast<char>(letter);
            }
        }
        return text;
    }
    return link.identify().value_or(kUnknown);
}

}  // namespace

Result<std::string> describe_module(const hal::Clock& clock, const drivers::ModbusRejectorOptions& options) {
    drivers::CoilLink link(clock, options.address, options.response_timeout);
    if (auto connected = link.connect(); !connected) return tl::unexpected(connected.error());
    std::string outputs;
    const auto add_output = [&](const char* what, int coil) -> Result<void> {
        if (coil < 0) return {};
        const auto value = link.read(coil + options.map.read_back_offset);
        if (!value) return tl::unexpected(value.error());
        outputs += fmt::format("; {} (coil {}) is {}", what, coil, *value ? 1 : 0);
        return {};
    };
    if (auto done = add_output("ejector", options.ejector_coil); !done) return tl::unexpected(done.error());
    if (auto done = add_output("run permit", options.permit_coil); !done) return tl::unexpected(done.error());
    if (options.confirm_input >= 0) {
        const auto value = link.read_input(options.confirm_input);
        if (!value) return tl::unexpected(value.error());
        outputs += fmt::format("; confirm sensor (input {}) is {}", options.confirm_input, *value ? 1 : 0);
    }
    return identity_of(link, options) + outputs;
}

}  // namespace hord::firmware
