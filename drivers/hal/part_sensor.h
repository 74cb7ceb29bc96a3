// The light barrier that detects parts, and optionally the conveyor's encoder.
#pragma once

#include <cstdint>
#include <optional>

#include "drivers/hal/clock.h"
#include "drivers/hal/device.h"

namespace hord::hal {

struct PartEdge {
    enum class Kind : std::uint8_t { arrives, leaves };
    Kind kind = Kind::arrives;
    TimePoint at;                        // the kernel's (or the simulated world's) time stamp, not the time of reading
    std::uint32_t sequence = 0;          // counts edges from 1; a gap means that edges were lost
    std::optional<std::int64_t> counts;  // encoder position at the edge; its zero may be another after each start()
};

// Delivered at a fixed rate, also while the conveyor stands: a missing reading means that the position is lost.
struct EncoderReading {
    TimePoint at;
    std::int64_t counts = 0;  // grows while the conveyor moves
};

class PartSensorListener {
  public:
    virtual void on_edge(const PartEdge& edge) = 0;
    virtual void on_encoder(const EncoderReading& reading) = 0;
    virtual void on_part_sensor_lost(const Error& error) = 0;  // delivered once; stop() and start() again to recover

  protected:
    ~PartSensorListener() = default;
};

// start() does not block. It fails with not_found or busy (the line).
class PartSensor : public Device<PartSensorListener> {
  protected:
    PartSensor() : Device("the part sensor") {}
};

}  // namespace hord::hal
