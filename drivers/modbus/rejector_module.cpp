#include "drivers/modbus/rejector_module.h"

#include <utility>

namespace hord::drivers {

using namespace std::chrono_literals;
using hal::Duration;

Result<void> RejectorModule::connect() {
    const ModuleMap& map = options_.map;
    if (auto done = link_.connect(); !done) return done;
    if (map.alarm_coil >= 0) {
        const auto alarm = link_.read(map.alarm_coil);
        if (!alarm) return tl::unexpected(alarm.error());
        if (*alarm) {
            if (auto done = link_.write(map.alarm_coil, true); !done) return done;
        }
    }
    if (options_.watchdog > 0ns) {
        if (auto done = start_watchdog(); !done) return done;
    }
    if (times_pulse() && map.pulse_width_register >= 0) {
        const auto units = static_cast<int>(options_.module_pulse / map.pulse_width_unit);
        if (auto done = link_.write_register(map.pulse_width_register, units); !done) return done;
    }
    if (options_.confirm_input >= 0) {
        const auto present = read_confirm_sensor();
        if (!present) return tl::unexpected(present.error());
        part_present_ = *present;
    }
    auto done = times_pulse() ? link_.write(pulse_coil(), false) : end_pulse();
    if (done) done = set_permit(false);
    return done;
}

// The time can only be set, and an expired watchdog only releases the outputs, while it is stopped.
Result<void> RejectorModule::start_watchdog() {
    const ModuleMap& map = options_.map;
    auto done = link_.write_register(map.watchdog_stop_register, map.watchdog_stop_value);
    const auto units = static_cast<int>((options_.watchdog + map.watchdog_unit - 1ns) / map.watchdog_unit);
    if (done) done = link_.write_register(map.watchdog_time_register, units);
    // Twice: one of the two values differs from the one that an earlier station left in the register.
    for (int k = 0; k < 2 && done; ++k) done = trigger_watchdog();
    return done;
}

Result<void> RejectorModule::trigger_watchdog() {
    last_trigger_ = last_trigger_ == 1 ? 2 : 1;
    watchdog_due_ = clock_.now() + options_.watchdog / 3;
    return link_.write_register(options_.map.watchdog_trigger_register, last_trigger_);
}

Result<void> RejectorModule::write_output(int coil, bool on) {
    return link_.write(coil, on, coil + options_.map.read_back_offset);
}

Result<void> RejectorModule::start_pulse() {
    return times_pulse() ? link_.write(pulse_coil(), true) : write_output(options_.ejector_coil, coil_value(true));
}

Result<void> RejectorModule::end_pulse() { return write_output(options_.ejector_coil, coil_value(false)); }

Result<void> RejectorModule::set_permit(bool permit) {
    if (options_.permit_coil < 0) return {};
    return write_output(options_.permit_coil, permit);
}

Result<void> RejectorModule::check_coil(int coil, int read_at, bool expected) {
    const auto value = link_.read(read_at);
    if (!value) return tl::unexpected(value.error());
    if (*value == expected) return {};
    return fail(ErrorCode::disconnected,
                "the rejector module at " + link_.name() + " lost its outputs: coil " + std::to_string(coil) + " is " +
                    (*value ? "1" : "0") + " (it restarted, its watchdog expired, or something else writes it)",
                "nothing to do if it restarted; else keep other writers away from its coils");
}

Result<void> RejectorModule::check_ejector(bool pulse) {
    if (times_pulse()) return check_coil(pulse_coil(), pulse_coil(), false);
    return check_coil(options_.ejector_coil, options_.ejector_coil + options_.map.read_back_offset, coil_value(pulse));
}

Result<void> RejectorModule::check_permit(bool permit) {
    return check_coil(options_.permit_coil, options_.permit_coil + options_.map.read_back_offset, permit);
}

Result<bool> RejectorModule::read_confirm_sensor() {
    return link_.read_input(options_.confirm_input).map([&](bool value) {
        return value != options_.confirm_active_low;
    });
}

Result<bool> RejectorModule::part_arrived() {
    return read_confirm_sensor().map([&](bool present) { return !std::exchange(part_present_, present) && present; });
}

bool RejectorModule::write_safe_outputs() {
    bool done = true;
    const auto then = [&](const Result<void>& written) { done = written.has_value() && done; };
    if (times_pulse()) then(link_.write(pulse_coil(), false));
    for (const int coil : {times_pulse() ? -1 : options_.ejector_coil, options_.permit_coil}) {
        if (coil >= 0 && link_.connected()) then(write_output(coil, false));
    }
    if (options_.watchdog > 0ns && link_.connected()) {
        then(link_.write_register(options_.map.watchdog_stop_register, options_.map.watchdog_stop_value));
    }
    return done && link_.connected();
}

void RejectorModule::make_safe(hal::TimePoint by) {
    link_.give_up_at(by);
    for (int attempt = 0; attempt < 3 && (attempt == 0 || clock_.now() < by); ++attempt) {
        // An answer that was late has closed the link: a new one is tried. A module that was not there is left alone.
        if (!link_.connected() && (attempt == 0 || !link_.connect())) break;
        if (write_safe_outputs()) break;
    }
    link_.close();
}

}  // namespace hord::drivers
