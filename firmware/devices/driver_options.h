// The configuration's devices as their drivers are told of them.
#pragma once

#include <string>
#include <vector>

#include "drivers/gpio/gpio_part_sensor.h"
#include "drivers/gpio/gpio_strobe.h"
#include "drivers/libcamera/camera_port.h"
#include "drivers/modbus/modbus_rejector.h"
#include "drivers/v4l2/v4l2_sensor.h"
#include "firmware/config/config.h"

namespace hord::firmware {

drivers::ModbusRejectorOptions rejector_options(const ModbusRejector& wanted);
drivers::GpioLine gpio_line(const GpioLineName& name);
std::vector<drivers::GpioStrobeChannel> strobe_channels(const StrobeConfig& wanted);
drivers::GpioPartSensorOptions part_sensor_options(const GpioPartSensorLine& wanted);
drivers::V4l2SensorOptions video_options(const VideoSensor& wanted);
drivers::CameraRequest camera_request(const CameraSensor& wanted);

// Asks a rejector's module what it is and how its outputs and its confirm sensor stand, over a link of its own; moves
// nothing. Blocks for a few time-outs. Fails as the driver's link does.
Result<std::string> ask_module(const hal::Clock& clock, const drivers::ModbusRejectorOptions& options);

}  // namespace hord::firmware
