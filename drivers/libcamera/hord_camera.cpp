// hord-camera: holds a libcamera camera for the station, which starts it (drivers/libcamera/camera_process.h).
#include <cstdio>

#include "drivers/libcamera/camera_host.h"

int main(int argc, char** argv) {
    const int status = hord::drivers::host_camera(argc, argv, hord::drivers::open_libcamera);
    if (status == 2)
        std::fputs(
            "hord-camera: started by the station alone, for a camera of libcamera's; nothing to do here: see "
            "hordd(8)\n",
            stderr);
    return status;
}
