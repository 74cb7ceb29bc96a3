#include <algorithm>
#include <array>

#include <strings.h>

#include "drivers/hal/camera_sensor.h"
#include "firmware/config/device_sections.h"
#include "firmware/config/shared_keys.h"

namespace hord::firmware {

using common::TomlTable;

namespace {

void refuse_other_cameras_keys(TomlTable& sensor, int backend, const drivers::V4l2SensorOptions& video,
                               const drivers::GenicamSensorOptions& genicam, bool green) {
    constexpr int kV4l2 = 2, kLibcamera = 3, kGenicam = 4;
    const std::string& camera = genicam.camera;
    const auto refuse = [&](bool set, const char* key, const char* cure) { firmware::refuse(sensor, set, key, cure); };
    const bool set_by_controls = backend == kV4l2 || backend == kLibcamera;
    refuse(!set_by_controls && !video.controls.empty(), "control",
           backend == kGenicam ? "set a GenICam camera's features, in [[sensor.feature]]"
                               : "take it out: only cameras of v4l2 and libcamera have controls");
    refuse(backend != kGenicam && !genicam.features.empty(), "feature",
           set_by_controls ? "set this camera's controls, in [[sensor.control]]; only GenICam cameras have features"
                           : "take it out, or set sensor.backend to \"genicam\"");
    if (backend < kV4l2) return;
    if (backend != kGenicam) {
        const drivers::GenicamSensorOptions unset;
        const char* const cure = "take it out: only GenICam cameras have it";
        refuse(genicam.offset_x_px != unset.offset_x_px, "offset_x_px", cure);
        refuse(genicam.offset_y_px != unset.offset_y_px, "offset_y_px", cure);
        refuse(genicam.pixel_format != unset.pixel_format, "pixel_format",
               "take it out: sensor.bits chooses the format");
        refuse(genicam.trigger != unset.trigger, "trigger",
               "take it out: the strobe's wire triggers this camera, or it runs free");
        refuse(genicam.trigger_source != unset.trigger_source, "trigger_source", cure);
        refuse(genicam.packet_bytes != unset.packet_bytes, "packet_bytes", cure);
        refuse(genicam.socket_buffer_bytes != unset.socket_buffer_bytes, "socket_buffer_bytes", cure);
    }
    refuse(backend != kLibcamera && green, "green", "take it out: only colour frames of libcamera need it");
    refuse(backend != kV4l2 && video.device != drivers::V4l2SensorOptions{}.device, "device",
           "take it out, and name the camera in sensor.camera");
    refuse(backend == kV4l2 && !camera.empty(), "camera", "take it out, and name the video device in sensor.device");
}

void check_genicam_format(TomlTable& sensor, const drivers::GenicamSensorOptions& options) {
    static constexpr std::array<std::pair<std::string_view, int>, 8> kFormats{{{"Mono8", 8},
                                                                               {"Mono10", 10},
                                                                               {"Mono10p", 10},
                                                                               {"Mono10Packed", 10},
                                                                               {"Mono12", 12},
                                                                               {"Mono12p", 12},
                                                                               {"Mono12Packed", 12},
                                                                               {"Mono16", 16}}};
    if (options.pixel_format.empty()) return;
    const auto* const known =
        std::ranges::find(kFormats, options.pixel_format, &std::pair<std::string_view, int>::first);
    if (known == kFormats.end())
        sensor.problem("pixel_format", "is no grey format that the station reads",
                       "use Mono8, Mono10, Mono10p, Mono10Packed, Mono12, Mono12p, Mono12Packed or Mono16; or leave it "
                       "out");
    else if (known->second != options.bits)
        sensor.problem("pixel_format",
                       "has samples of " + std::to_string(known->second) + " bits, and sensor.bits is " +
                           std::to_string(options.bits),
                       "change one of them, or leave pixel_format out");
}

// The keys of a GenICam camera alone; `options` has those that all cameras share.
void read_genicam(TomlTable& sensor, bool chosen, drivers::GenicamSensorOptions& options) {
    sensor.integer("offset_x_px", options.offset_x_px, 0, 65'535);
    sensor.integer("offset_y_px", options.offset_y_px, 0, 65'535);
    sensor.text("pixel_format", options.pixel_format);
    sensor.choice("trigger", {"line", "software", "free"}, options.trigger);
    sensor.text("trigger_source", options.trigger_source);
    sensor.integer("packet_bytes", options.packet_bytes, 0, 16'000);
    if (options.packet_bytes > 0 && options.packet_bytes < drivers::kSmallestGvspPacket)
        sensor.problem("packet_bytes", "is smaller than every GigE Vision camera's packets",
                       "set 0, which negotiates it, or 576 to the MTU of the whole way");
    sensor.integer("socket_buffer_bytes", options.socket_buffer_bytes, 0, 1 << 30);
    for (TomlTable& feature : sensor.tables("feature")) {
        auto& [name, value] = options.features.emplace_back();
        feature.text("name", name);
        feature.scalar("value", value);
        if (name.empty()) feature.problem("name", "is missing", "name the feature as the camera's manual does");
        if (!feature.has("value")) feature.problem("value", "is missing", "say what the feature is set to");
        for (const auto& [of_camera, key] : {std::pair("PixelFormat", "sensor.pixel_format"),
                                             {"Width", "sensor.width_px"},
                                             {"Height", "sensor.height_px"},
                                             {"TriggerMode", "sensor.trigger"},
                                             {"TriggerSource", "sensor.trigger_source"},
                                             {"OffsetX", "sensor.offset_x_px"},
                                             {"OffsetY", "sensor.offset_y_px"}}) {
            // A camera has no other feature whose name differs by its letters' case alone.
            if (chosen && ::strcasecmp(name.c_str(), of_camera) == 0)
                feature.problem("name", "would override " + std::string(key), "set " + std::string(key) + " instead");
        }
        for (const char* const by_station : {"AcquisitionMode", "AcquisitionStart", "AcquisitionStop"}) {
            if (chosen && ::strcasecmp(name.c_str(), by_station) == 0)
                feature.problem("name", std::string("is the station's: it sets ") + by_station + " by itself",
                                "take it out");
        }
    }
    if (chosen && options.trigger == drivers::CameraTrigger::line && options.trigger_source.empty()) {
        sensor.problem("trigger_source", "is missing",
                       "name the camera's input that the strobe's line triggers, such as \"Line1\"; or set trigger to "
                       "\"software\" or \"free\"");
    }
    refuse(sensor, chosen && options.trigger != drivers::CameraTrigger::line && !options.trigger_source.empty(),
           "trigger_source", "take it out, or set trigger to \"line\"", "has no effect with this sensor.trigger");
    if (chosen && options.trigger == drivers::CameraTrigger::line && options.trigger_source == "Software")
        sensor.problem("trigger_source", "is no input",
                       "name the camera's input, such as \"Line1\"; or set trigger to "
                       "\"software\"");
    if (chosen) check_genicam_format(sensor, options);
}

}  // namespace

void read_sensor(TomlTable sensor, SensorConfig& value, const std::filesystem::path& folder) {
    int backend = 0;
    sensor.choice("backend", {"simulated", "frames", "v4l2", "libcamera", "genicam"}, backend);
    std::string frames, scenes;
    sensor.text("folder", frames);
    sensor.text("scenes", scenes);
    refuse(sensor, backend != 0 && !scenes.empty(), "scenes", "take it out: only the simulated sensor has scenes");
    refuse(sensor, backend != 1 && !frames.empty(), "folder", "take it out, or set sensor.backend to \"frames\"");
    if (backend == 0 && !scenes.empty()) value = SimulatedSensor{folder / scenes};
    drivers::V4l2SensorOptions video;
    sensor.text("device", video.device);
    std::string camera;
    sensor.text("camera", camera);
    bool green = false;
    sensor.boolean("green", green);
    sensor.integer("width_px", video.width_px, 0, 65'535);
    sensor.integer("height_px", video.height_px, 0, 65'535);
    sensor.integer("bits", video.bits, 8, 16);
    sensor.integer("buffers", video.buffers, drivers::CameraSensor::kMinBuffers, drivers::CameraSensor::kMaxBuffers);
    if (video.bits != 8 && video.bits != 10 && video.bits != 12 && video.bits != 16) {
        sensor.problem("bits", "is no depth that the station reads",
                       "use 8, 10, 12 or 16, and set the camera to it (one of 14 bits to 12, or to 16; if its largest "
                       "value is then 16383, set saturated_dn in the recipe's [light] to that)");
    }
    for (TomlTable& control : sensor.tables("control")) {
        auto& [name, setting] = video.controls.emplace_back();
        control.text("name", name);
        control.integer("value", setting, INT32_MIN, INT32_MAX);
        if (name.empty())
            control.problem("name", "is missing",
                            "name the control as v4l2-ctl --list-ctrls, or cam --list-controls, calls it");
        if (!control.has("value")) control.problem("value", "is missing", "say what the control is set to");
    }
    drivers::GenicamSensorOptions genicam{.camera = camera,
                                          .width_px = video.width_px,
                                          .height_px = video.height_px,
                                          .bits = video.bits,
                                          .buffers = video.buffers};
    read_genicam(sensor, backend == 4, genicam);
    refuse_other_cameras_keys(sensor, backend, video, genicam, green);
    if (backend == 4) value = genicam;
    if (backend == 2) value = video;
    if (backend == 3)
        value = drivers::LibcameraSensorOptions{camera,        video.width_px, video.height_px, video.bits,
                                                video.buffers, green,          video.controls};
    if (backend != 1) return;
    if (frames.empty()) sensor.problem("folder", "is missing", "name the folder of the recorded frames");
    value = FrameFolder{folder / frames, sensor.has("bits") ? video.bits : 0, video.width_px, video.height_px};
}

}  // namespace hord::firmware
