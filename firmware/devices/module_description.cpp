// Reads the identity of a rejector's module and the state of its outputs.
#include <algorithm>
#include <optional>
#include <string_view>

#include <fmt/format.h>

#include "drivers/modbus/coil_link.h"
#include "firmware/config/module_profiles.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {
namespace {

constexpr const char* kUnknown = "a module that does not say what it is";

// From the registers that `map` names. None: the module does not have them.
std::optional<std::string> name_in_registers(drivers::CoilLink& link, const drivers::ModuleMap& map) {
    using Kind = drivers::CoilLink::RegisterKind;
    const auto words = link.read_registers(map.name_words == 0 ? Kind::holding : Kind::input, map.name_register,
                                           std::max(1, map.name_words));
    if (!words) return std::nullopt;
    if (map.name_words == 0) return std::string(map.name_prefix) + std::to_string(words->front());
    std::string text;
    for (const std::uint16_t word : *words) {
        for (const int letter : {word >> 8, word & 0xFF}) {
            if (letter >= 0x20 && letter < 0x7F) text += static_cast<char>(letter);
        }
    }
    return text;
}

// From the registers named in the module map, else by Read Device Identification (function 43/14).
std::string identity_of(drivers::CoilLink& link, const drivers::ModbusRejectorOptions& options) {
    if (options.map.name_register >= 0) return name_in_registers(link, options.map).value_or(kUnknown);
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

Result<ModuleIdentity> identify_module(const hal::Clock& clock, const drivers::ModuleAddress& address,
                                       hal::Duration patience) {
    drivers::CoilLink link(clock, address, patience);
    if (auto connected = link.connect(); !connected) return tl::unexpected(connected.error());
    const auto said = link.identify();
    if (said) return ModuleIdentity{*said, std::string(module_profiles().front().name), 0};
    if (said.error().code == ErrorCode::unreadable || said.error().code == ErrorCode::refused)
        return tl::unexpected(said.error());
    bool answered = said.error().code == ErrorCode::unsupported;
    for (const ModuleProfile& profile : module_profiles()) {
        if (profile.map.name_register < 0) continue;
        if (!link.connected()) {
            if (auto connected = link.connect(); !connected) return tl::unexpected(connected.error());
        }
        const auto name = name_in_registers(link, profile.map);
        answered = answered || link.connected();
        // Any module may have some number at this place: a WAGO's has three digits.
        const bool fits = name && !name->empty() &&
            (profile.map.name_words > 0 || name->size() == profile.map.name_prefix.size() + 3);
        if (fits) return ModuleIdentity{*name, std::string(profile.name), profile.map.first_output};
    }
    if (!answered) return tl::unexpected(said.error());
    return ModuleIdentity{};
}

}  // namespace hord::firmware
