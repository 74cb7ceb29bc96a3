// What the station publishes, as registers: the model behind the Modbus server.
//
// publish() takes the station's word at one moment; every read is answered from one such moment, whole. Any
// thread may publish, any thread may read: a lock is held for the copy only.
#pragma once

#include "firmware/modbus/dispatcher.h"
#include "firmware/registers.h"
#include "firmware/snapshot.h"

#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

namespace hord::firmware {

class RegisterImage : public modbus::RegisterModel {
  public:
    explicit RegisterImage(StationIdentity identity);

    // Allocates nothing. About 40 rows are encoded outside the lock.
    void publish(const Snapshot& snapshot);

    modbus::Exception read_registers(std::uint16_t address, std::span<std::uint16_t> out) override;
    [[nodiscard]] std::string_view identification(std::uint8_t object) const override;

  private:
    const StationIdentity identity_;
    const std::string boot_text_, map_text_;
    std::mutex publishing_;  // one publisher at a time: guards staged_
    std::vector<std::uint16_t> staged_;
    std::mutex reading_;  // guards words_
    std::vector<std::uint16_t> words_;
};

}  // namespace hord::firmware
