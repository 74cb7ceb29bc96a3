// The libcamera sensor behind the contract suite, over a camera that is a thread of the test: libcamera's own part has no camera here.
#include "drivers/libcamera_sensor.h"
#include "tests/contract/harness.h"
#include "tests/drivers/fake_camera.h"

namespace hord::contract {
namespace {

class LibcameraHarness final : public SensorHarness {
  public:
    LibcameraHarness() : SensorHarness(real_loop()), camera_(std::make_shared<drivers::FakeCamera>(loop())) {
        drivers::CameraRequest request;
        auto opened = drivers::LibcameraSensor::open(loop(), request, std::make_unique<drivers::FakeCameraPort>(camera_, request.buffers));
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
    std::unique_ptr<drivers::LibcameraSensor> sensor_;
};

INSTANTIATE_TEST_SUITE_P(Libcamera, SensorContract,
                         testing::Values(Backend<SensorHarness>{"fake_camera", [] { return std::make_unique<LibcameraHarness>(); }, ""}),
                         name_of<SensorHarness>);

}  // namespace
}  // namespace hord::contract
