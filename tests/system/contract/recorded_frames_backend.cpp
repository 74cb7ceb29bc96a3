// Recorded frames in the sensor's contract suite, in virtual time.
#include "drivers/files/recorded_frames.h"
#include "tests/support/temp_folder.h"
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

class RecordedHarness final : public SensorHarness {
  public:
    RecordedHarness() : SensorHarness(virtual_loop()) {
        for (int k = 0; k < 30; ++k) {
            Frame frame(27, 18, 8);
            for (int x = 0; x < 27; ++x) frame.set(x, k % 18, static_cast<std::uint32_t>(k + x));
            const std::string name = (k < 10 ? "0" : "") + std::to_string(k) + ".png";
            EXPECT_TRUE(drivers::write_frame(folder_.path() / name, frame.view()));
        }
        auto opened = drivers::RecordedFrames::open(loop(), {folder_.path()});
        EXPECT_TRUE(opened) << opened.error().message();
        sensor_ = std::move(*opened);
    }
    hal::Sensor& device() override { return *sensor_; }

  private:
    testing_support::TempFolder folder_;
    std::unique_ptr<drivers::RecordedFrames> sensor_;
};

INSTANTIATE_TEST_SUITE_P(RecordedFrames, SensorContract,
                         testing::Values(Backend<SensorHarness>{
                             "once", [] { return std::make_unique<RecordedHarness>(); }, ""}),
                         name_of<SensorHarness>);

}  // namespace
}  // namespace hord::contract
