// The line of the rig: parts on a belt, what the light barrier's wire, the camera and the rejector's module do, and the
// faults of each. It checks the fate of every part, and the state that a killed station leaves.
#pragma once

#include <cstdint>
#include <string>

namespace hord::rig {

struct LineOptions {
    std::string chip, video, frames, faults;
    int port = 1503;     // of the module
    std::string serial;  // instead of the port: the far end of the station's serial line
    std::string person;  // address of the station's registers: a Person clears the belt and resets it; empty: no Person
    int kills = 0;       // number of kills of hordd.service at random moments; the run ends after them
    int safe_ms = 0;     // longest time from a kill to lights off and outputs at rest; 0: reported, not checked
    std::uint64_t parts = 20, seed = 1;
    double good_share = 0.6, speed_mm_s = 50, pitch_mm = 100, part_mm = 40, camera_mm = 35, ejector_mm = 300;
    int light_ms = 200, readout_ms = 250, patience_s = 300;
};

// Returns 0 if every part came, left and had the expected fate (with kills: the station recovered from each), else 1.
// Throws std::runtime_error when the rig's devices or files are not as expected.
int run_line(const LineOptions& options);

}  // namespace hord::rig
