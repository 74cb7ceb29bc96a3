// A V4L2 device in the sensor's contract suite, on machines that have one. HORD_V4L2_DEVICE is its path (an 8-bit GREY
// source); HORD_V4L2_LOSE is the command that makes it fail.
#include <cstdlib>

#include "drivers/v4l2/v4l2_sensor.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class V4l2Harness final : public SensorHarness {
  public:
    explicit V4l2Harness(const char* device) : SensorHarness(real_loop()) {
        drivers::V4l2SensorOptions options;
        options.device = device;
        auto opened = drivers::V4l2Sensor::open(loop(), options);
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::Sensor& device() override { return *sensor_; }
    bool lose() override {
        const char* command = std::getenv("HORD_V4L2_LOSE");
        return command != nullptr && std::system(command) == 0;
    }

  private:
    std::unique_ptr<drivers::V4l2Sensor> sensor_;
};

std::unique_ptr<SensorHarness> make() {
    const char* device = std::getenv("HORD_V4L2_DEVICE");
    if (device == nullptr) return nullptr;
    return std::make_unique<V4l2Harness>(device);
}

INSTANTIATE_TEST_SUITE_P(V4l2, SensorContract,
                         testing::Values(Backend<SensorHarness>{
                             "device", make, "HORD_V4L2_DEVICE names no video device on this machine"}),
                         name_of<SensorHarness>);

}  // namespace
}  // namespace hord::contract
