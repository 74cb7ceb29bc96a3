// hord-camera: holds a libcamera camera for the station, which starts it (drivers/camera_process/camera_process.h).
#include "drivers/libcamera/libcamera_device.h"

int main(int argc, char** argv) { return hord::drivers::host_camera(argc, argv, hord::drivers::open_libcamera); }
