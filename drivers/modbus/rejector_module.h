// A rejector's Modbus module: its outputs, its watchdog and its confirm sensor. Blocking, one thread.
#pragma once

#include "drivers/modbus/coil_link.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::drivers {

// Requests take response_timeout at most and fail as CoilLink's do.
class RejectorModule {
  public:
    RejectorModule(const hal::Clock& clock, const ModbusRejectorOptions& options)
        : clock_(clock), options_(options), link_(clock, options.address, options.response_timeout) {}

    // True: the module times the pulse by itself (module_pulse), and end_pulse() has nothing to write.
    [[nodiscard]] bool times_pulse() const { return options_.module_pulse > hal::Duration::zero(); }

    [[nodiscard]] CoilLink& link() { return link_; }

    // Opens the link and writes the safe state first: it ends what an earlier command may have left on.
    Result<void> connect();
    Result<void> start_pulse();
    Result<void> end_pulse();
    Result<void> set_permit(bool permit);

    // Fail with disconnected if the output does not read back as last written. `pulse`: a pulse is under way.
    // With a module that times the pulse, call check_ejector() only between pulses.
    Result<void> check_ejector(bool pulse);
    Result<void> check_permit(bool permit);

    // Reads the confirm sensor. True: a part arrived since the last reading.
    Result<bool> part_arrived();
    [[nodiscard]] bool part_present() const { return part_present_; }  // when last read

    Result<void> trigger_watchdog();
    [[nodiscard]] hal::TimePoint watchdog_due() const { return watchdog_due_; }  // max(): no watchdog is set

    // Sets all coils to 0, the state of a module without a link, stops the watchdog and closes the link. If an answer
    // is late it tries again, on a new link. Returns at `by`.
    void make_safe(hal::TimePoint by);

  private:
    bool write_safe_outputs();  // false: not all of them were acknowledged
    [[nodiscard]] bool coil_value(bool act) const { return act != options_.energise_to_pass; }
    [[nodiscard]] int pulse_coil() const { return options_.ejector_coil + options_.map.pulse_coil_offset; }
    Result<void> write_output(int coil, bool on);
    Result<void> check_coil(int coil, int read_at, bool expected);
    Result<bool> read_confirm_sensor();
    Result<void> start_watchdog();

    const hal::Clock& clock_;
    const ModbusRejectorOptions options_;
    bool part_present_ = false;
    int last_trigger_ = 0;
    hal::TimePoint watchdog_due_ = hal::TimePoint::max();
    CoilLink link_;
};

}  // namespace hord::drivers
