// hord-genicam: holds a GenICam camera for the station, which starts it (drivers/camera_process/camera_process.h).
#include "drivers/camera_process/camera_host.h"
#include "drivers/genicam/genicam_device.h"
#include "drivers/genicam/genicam_request.h"

int main(int argc, char** argv) {
    return hord::drivers::host_camera(argc, argv, [](const std::string& request) {
        const auto options = hord::drivers::parse_genicam_request(request);
        return options ? hord::drivers::open_genicam(*options) : nullptr;
    });
}
