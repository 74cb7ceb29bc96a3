// The station's published values as registers: the model behind the Modbus servers.
//
// Every request is answered from one consistent state. Any thread may publish; the lock is held only to copy. Reads and
// writes on the loop's thread (reads on any thread without a PlcInterface).
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>

#include "firmware/modbus/dispatcher.h"
#include "firmware/plc/plc_interface.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {

class RegisterServerModel : public modbus::RegisterModel {
  public:
    // `plc_interface` handles writes and outlives this. Without it every write is refused with exception 02.
    explicit RegisterServerModel(StationIdentity identity, PlcInterface* plc_interface = nullptr);

    // Any thread, allocates nothing. State and new results become visible together. Results are published once each, by
    // ascending sequence; snapshot.last counts as one of them.
    void publish(const Snapshot& snapshot, std::span<const PartResult> results = {});
    void publish(const RecipeInUse& recipe) { set(&RegisterExtras::recipe, recipe); }
    void publish(const HealthReport& health) { set(&RegisterExtras::health, health); }
    void publish(const CalibrationReport& calibration) { set(&RegisterExtras::calibration, calibration); }

    modbus::Exception read_registers(std::uint16_t address, std::span<std::uint16_t> out) override;
    // 0..15 STATUS `bits`, 16..47 `faults_active`, 48..79 `faults_latched`, 80 the lowest bit of the PLC's
    // heartbeat, the only one to write.
    modbus::Exception read_bits(std::uint16_t address, std::span<bool> out) override;
    modbus::Exception write_registers(const modbus::Origin& origin, std::uint16_t address,
                                      std::span<const std::uint16_t> values) override;
    modbus::Exception write_bits(const modbus::Origin& origin, std::uint16_t address,
                                 std::span<const bool> values) override;
    [[nodiscard]] std::string_view identification(std::uint8_t object) const override;

  private:
    struct State {
        Snapshot snapshot;
        PartResult newest;
        std::int64_t newest_at_ns = 0;  // station time at which `newest` was published
        RegisterExtras extras;          // without what read_registers() adds: statistics and the PLC's side
    };
    template <class Report>
    void set(Report RegisterExtras::*member, const Report& report) {
        const std::lock_guard lock(mutex_);
        state_.extras.*member = report;
    }
    [[nodiscard]] StationNow now();
    [[nodiscard]] ResultStatistics statistics();

    const StationIdentity identity_;
    const std::string boot_text_, map_text_;
    PlcInterface* const plc_interface_;
    std::mutex mutex_;  // guards the rest
    State state_;
    std::array<PartResult, kRingSlots> ring_{};
};

}  // namespace hord::firmware
