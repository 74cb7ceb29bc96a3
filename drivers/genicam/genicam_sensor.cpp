#include "drivers/genicam/genicam_sensor.h"

#include "drivers/genicam/genicam_request.h"

namespace hord::drivers {
namespace {

std::string cure_of_silence(const GenicamSensorOptions& options) {
    const std::string network = "its power and its cable, and the network's errors (ip -s link)";
    if (options.trigger != CameraTrigger::line) return "check " + network;
    return "check that the strobe's wire is on the input of sensor.trigger_source, \"" + options.trigger_source +
        "\", and that its pulses reach it; then " + network;
}

CameraTriggers triggers_of(CameraTrigger trigger) {
    switch (trigger) {
        case CameraTrigger::line: return CameraTriggers::wire;
        case CameraTrigger::software: return CameraTriggers::command;
        case CameraTrigger::free: break;
    }
    return CameraTriggers::unknown;
}

}  // namespace

Result<std::unique_ptr<CameraPortSensor>> open_genicam_sensor(hal::EventLoop& loop, const GenicamSensorOptions& options,
                                                              const std::filesystem::path& program) {
    return CameraPortSensor::open(loop,
                                  {.name = options.camera.empty() ? "the camera" : options.camera,
                                   .buffers = options.buffers,
                                   .triggers = triggers_of(options.trigger),
                                   .strobe_commands = !options.light_line.empty(),
                                   .cure_of_silence = cure_of_silence(options)},
                                  open_camera_process(request_of(options), program));
}

}  // namespace hord::drivers
