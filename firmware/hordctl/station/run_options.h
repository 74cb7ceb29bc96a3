// The options of `hordctl run`, and the configuration that follows from them.
#pragma once

#include <string>

#include "firmware/config/config.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {

struct RunOptions {
    std::string config, modbus, out, store, state, vitals;
    bool simulate = false, json = false;
    SimulationOptions line;
    bool good_given = false, variety_given = false;  // of `line`, on the command line
    int vitals_every_s = 10, reset_after_s = 0;
};

// The configuration of the file, or without one the usual, with what the options change. Looks at no file that the
// configuration names. Fails with invalid_argument (options that do not go together, or that would have no effect) and
// as load_config() does.
Result<Config> config_of_run(const RunOptions& options);

}  // namespace hord::firmware
