// OpticsMonitor: limits from the configuration, values for the registers.
#pragma once

#include "firmware/config/config.h"
#include "firmware/monitoring/optics_monitor.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

// `bits`: of a frame's sample.
OpticsLimits limits_of(const OpticsConfig& config, int bits);

OpticsReport report_of(const OpticsMonitor::View& view);

}  // namespace hord::firmware
