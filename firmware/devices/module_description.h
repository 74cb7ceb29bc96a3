// What a rejector's module says of itself.
#pragma once

#include <string>

#include "common/result.h"
#include "drivers/hal/clock.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::firmware {

// The module's name and the state of its outputs. Changes nothing; blocks for up to a few response time-outs. Fails as
// the link to the module does.
Result<std::string> describe_module(const hal::Clock& clock, const drivers::ModbusRejectorOptions& options);

}  // namespace hord::firmware
