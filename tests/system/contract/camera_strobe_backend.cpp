// The light that a GenICam camera's own output drives, in the contract suite: on the fake GigE camera, which has such
// an output in its description. Whether it is lit cannot be seen.
#include "drivers/camera_process/camera_strobe.h"
#include "drivers/genicam/genicam_sensor.h"
#include "tests/drivers/genicam/fake_gige.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;

constexpr hal::Duration kExposure = 400ms;

class CameraStrobeHarness final : public StrobeHarness, hal::Sensor::Listener {
  public:
    CameraStrobeHarness() : StrobeHarness(real_loop()) {
        auto opened = drivers::open_genicam_sensor(loop(),
                                                   {.width_px = 64,
                                                    .height_px = 48,
                                                    .trigger = drivers::CameraTrigger::software,
                                                    .light_line = "Line2",
                                                    .light_us = kExposure / 1us});
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
        strobe_ =
            std::make_unique<drivers::CameraStrobe>(loop(), *sensor_, hal::LightLimits{kExposure, 5ms, 1}, kExposure);
        EXPECT_TRUE(sensor_->start(*this));
    }
    ~CameraStrobeHarness() override {
        strobe_.reset();
        sensor_->stop();
    }
    hal::Strobe& device() override { return *strobe_; }
    bool lose() override {
        camera_.lose();
        return true;
    }
    void bring_back() override {
        camera_.bring_back();
        sensor_->stop();
        const auto started = sensor_->start(*this);
        EXPECT_TRUE(started) << started.error().message();
    }

  private:
    void on_frame(hal::FrameLease) override {}
    void on_sensor_lost(const Error&) override {}
    test::FakeGige camera_{{"127.0.0.1", "S1", "lines"}};
    std::unique_ptr<drivers::CameraPortSensor> sensor_;
    std::unique_ptr<drivers::CameraStrobe> strobe_;
};

std::unique_ptr<StrobeHarness> make() {
    if (!std::filesystem::exists(std::filesystem::path(HORD_BIN_DIR) / "hord_fake_gige")) return nullptr;
    if (!test::own_network().empty()) return nullptr;
    return std::make_unique<CameraStrobeHarness>();
}

INSTANTIATE_TEST_SUITE_P(Camera, StrobeContract,
                         testing::Values(Backend<StrobeHarness>{
                             "own_output", make, "no fake camera, or this user gets no network namespace"}),
                         name_of<StrobeHarness>);

}  // namespace
}  // namespace hord::contract
