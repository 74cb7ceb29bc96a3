// The libcamera sensor in the contract suite: with a fake camera on every machine, with libcamera where there is a
// camera. HORD_LIBCAMERA is its id, with "any" for the only one there is (vimc, in the rig); HORD_LIBCAMERA_LOSE and
// _RETURN are commands that remove the camera and bring it back.
#include <cstdlib>
#include <string>

#include "drivers/libcamera/libcamera_options.h"
#include "drivers/libcamera/libcamera_sensor.h"
#include "tests/drivers/camera_process/fake_camera.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class LibcameraHarness final : public SensorHarness {
  public:
    LibcameraHarness() : SensorHarness(real_loop()), camera_(std::make_shared<drivers::FakeCamera>(loop())) {
        const drivers::CameraPortOptions options;
        auto opened = drivers::CameraPortSensor::open(
            loop(), options, std::make_unique<drivers::FakeCameraPort>(camera_, options.buffers));
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::Sensor& device() override { return *sensor_; }
    bool lose() override {
        camera_->be_there(false);
        return true;
    }
    void bring_back() override { camera_->be_there(true); }

  private:
    std::shared_ptr<drivers::FakeCamera> camera_;
    std::unique_ptr<drivers::CameraPortSensor> sensor_;
};

class RealCameraHarness final : public SensorHarness {
  public:
    explicit RealCameraHarness(const std::string& camera) : SensorHarness(real_loop()) {
        // Small, because vimc scales in software; both multiples of six, as vimc requires.
        auto opened = drivers::open_libcamera_sensor(
            loop(), {.camera = camera == "any" ? "" : camera, .width_px = 96, .height_px = 72, .green = true});
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::Sensor& device() override { return *sensor_; }
    bool lose() override { return does("HORD_LIBCAMERA_LOSE"); }
    void bring_back() override { EXPECT_TRUE(does("HORD_LIBCAMERA_RETURN")); }

  private:
    static bool does(const char* variable) {
        const char* command = std::getenv(variable);
        return command != nullptr && std::system(command) == 0;
    }
    std::unique_ptr<drivers::CameraPortSensor> sensor_;
};

std::unique_ptr<SensorHarness> on_camera() {
    const char* camera = std::getenv("HORD_LIBCAMERA");
    if (camera == nullptr) return nullptr;
    return std::make_unique<RealCameraHarness>(camera);
}

INSTANTIATE_TEST_SUITE_P(
    Libcamera, SensorContract,
    testing::Values(Backend<SensorHarness>{"fake_camera", [] { return std::make_unique<LibcameraHarness>(); }, ""},
                    Backend<SensorHarness>{"camera", on_camera, "HORD_LIBCAMERA names no camera on this machine"}),
    name_of<SensorHarness>);

}  // namespace
}  // namespace hord::contract
