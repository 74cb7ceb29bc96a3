// A light barrier on a GenICam camera's input, in the contract suite: on the fake GigE camera, which tells its edges.
#include "drivers/camera_process/camera_part_sensor.h"
#include "drivers/genicam/genicam_sensor.h"
#include "tests/drivers/genicam/fake_gige.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;

class CameraPartSensorHarness final : public PartSensorHarness, hal::Sensor::Listener {
  public:
    CameraPartSensorHarness() : PartSensorHarness(real_loop()) {
        auto opened = drivers::open_genicam_sensor(
            loop(),
            {.width_px = 64, .height_px = 48, .trigger = drivers::CameraTrigger::software, .barrier_line = "Line1"});
        EXPECT_TRUE(opened) << opened.error().message();
        camera_sensor_ = std::move(*opened);
        barrier_ = std::make_unique<drivers::CameraPartSensor>(loop(), *camera_sensor_, false);
        EXPECT_TRUE(camera_sensor_->start(*this));
    }
    ~CameraPartSensorHarness() override {
        barrier_.reset();
        camera_sensor_->stop();
    }
    hal::PartSensor& device() override { return *barrier_; }
    void pass_part() override {
        loop().call_after(10ms, [this] { camera_.set_input(true); });
        loop().call_after(20ms, [this] { camera_.set_input(false); });
    }
    bool lose() override {
        // Found by its silence, which is quicker than its heartbeat.
        EXPECT_TRUE(camera_sensor_->trigger({.exposure = 1, .start = now(), .length = 1ms}));
        camera_.lose();
        return true;
    }
    void bring_back() override {
        camera_.bring_back();
        camera_sensor_->stop();
        const auto started = camera_sensor_->start(*this);
        EXPECT_TRUE(started) << started.error().message();
    }

  private:
    void on_frame(hal::FrameLease) override {}
    void on_sensor_lost(const Error&) override {}
    test::FakeGige camera_{{"127.0.0.1", "S1", "events"}};
    std::unique_ptr<drivers::CameraPortSensor> camera_sensor_;
    std::unique_ptr<drivers::CameraPartSensor> barrier_;
};

std::unique_ptr<PartSensorHarness> make() {
    if (!std::filesystem::exists(std::filesystem::path(HORD_BIN_DIR) / "hord_fake_gige")) return nullptr;
    if (!test::own_network().empty()) return nullptr;
    return std::make_unique<CameraPartSensorHarness>();
}

INSTANTIATE_TEST_SUITE_P(Camera, PartSensorContract,
                         testing::Values(Backend<PartSensorHarness>{
                             "own_input", make, "no fake camera, or this user gets no network namespace"}),
                         name_of<PartSensorHarness>);

}  // namespace
}  // namespace hord::contract
