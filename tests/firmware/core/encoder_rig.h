// A line whose conveyor has an encoder.
#pragma once

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {

inline CoreConfig with_encoder() {
    CoreConfig c = quick_line();
    c.by_encoder = true;  // 1800 counts to the ejector: 180 ms at 10 counts a millisecond
    return c;
}

class Encoder : public ::testing::Test {
  protected:
    Encoder() {
        rig.bring_to(State::continuous_execution);
        rig.belt(0);
        run(milliseconds(50), 10);
    }
    // The belt moves `per_ms` counts a millisecond and is read every 10 ms.
    void run(Duration by, std::int64_t per_ms) {
        for (Duration done{}; done < by; done += milliseconds(10)) {
            rig.advance(milliseconds(10));
            rig.belt(10 * per_ms);
        }
    }
    std::uint32_t bad_part() {
        const auto part = rig.part_arrives();  // reaches the camera 50 counts (5 ms) later
        rig.advance(milliseconds(10));
        rig.belt(100);
        rig.light_comes(part);
        rig.frame_comes(part);
        rig.judged(part, algo::Verdict::reject, algo::Reason::deflection_gradient);
        return part;
    }

    CoreRig rig{with_encoder()};
};

}  // namespace hord::firmware
