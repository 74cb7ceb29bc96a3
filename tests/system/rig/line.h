// The line of the rig: parts on a belt, what the light barrier's wire, the camera and the rejector's module do, and the
// faults of each. It judges what became of every part, and what a killed station left behind.
#pragma once

#include <cstdint>
#include <string>

namespace hord::rig {

struct LineOptions {
    std::string chip, video, frames, faults;
    int port = 1503;     // of the module
    std::string serial;  // instead: the far end of the station's serial line
    std::string person;  // the station's registers: somebody clears the belt and resets it; empty: nobody does
    int kills = 0;       // how often hordd.service is killed, at random moments; then it is over
    int safe_ms = 0;     // longest time from a kill to lights off and outputs at rest; 0: only told
    std::uint64_t parts = 20, seed = 1;
    double good_share = 0.6, speed_mm_s = 50, pitch_mm = 100, part_mm = 40, camera_mm = 35, ejector_mm = 300;
    int light_ms = 200, readout_ms = 250, patience_s = 300;
};

// 0: every part came, left, and had the fate that it should have (with kills: every one was survived); else 1. Throws
// std::runtime_error where something is not as the rig makes it.
int run_line(const LineOptions& options);

}  // namespace hord::rig
