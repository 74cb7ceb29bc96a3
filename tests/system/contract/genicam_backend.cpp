// A GenICam sensor in the contract suite, on the fake GigE camera in a network of this process's own.
#include "drivers/genicam/genicam_sensor.h"
#include "tests/drivers/genicam/fake_gige.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class GenicamHarness final : public SensorHarness {
  public:
    GenicamHarness() : SensorHarness(real_loop()) {
        auto opened = drivers::open_genicam_sensor(
            loop(), {.width_px = 64, .height_px = 48, .trigger = drivers::CameraTrigger::software});
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::Sensor& device() override { return *sensor_; }
    bool lose() override {
        camera_.lose();
        return true;
    }
    void bring_back() override { camera_.bring_back(); }

  private:
    test::FakeGige camera_;
    std::unique_ptr<hal::Sensor> sensor_;
};

std::unique_ptr<SensorHarness> make() {
    if (!std::filesystem::exists(std::filesystem::path(HORD_BIN_DIR) / "hord_fake_gige")) return nullptr;
    if (!test::own_network().empty()) return nullptr;
    return std::make_unique<GenicamHarness>();
}

INSTANTIATE_TEST_SUITE_P(Genicam, SensorContract,
                         testing::Values(Backend<SensorHarness>{
                             "fake_gige", make, "no fake camera, or this user gets no network namespace"}),
                         name_of<SensorHarness>);

}  // namespace
}  // namespace hord::contract
