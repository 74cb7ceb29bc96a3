// What the registers show of the watch over light and optics, and what the configuration tells it.
#pragma once

#include "firmware/config/config.h"
#include "firmware/monitoring/optics_monitor.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

// Of frames of so many bits a sample.
OpticsLimits limits_of(const OpticsConfig& config, int bits);

OpticsReport report_of(const OpticsMonitor::View& view);

}  // namespace hord::firmware
