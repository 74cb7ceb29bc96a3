// Light fields of a folder, and their exposures.
#include "lab/reference/light_fields.h"

#include <cmath>
#include <fstream>

#include <gtest/gtest.h>

#include "drivers/files/frame_file.h"

namespace hord::lab {
namespace {

constexpr int kLenslets = 20, kBins = 5, kSide = kLenslets * kBins;

// Every bin is filled by the source.
class LightFields : public testing::Test {
  protected:
    void SetUp() override {
        folder_ =
            std::filesystem::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
        std::filesystem::create_directories(folder_);
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }
    void write(const std::string& name, const std::string& notes) const {
        Frame frame(kSide, kSide, 16);
        for (int y = 0; y < kSide; ++y) {
            for (int x = 0; x < kSide; ++x) frame.set(x, y, static_cast<std::uint32_t>(kFilledBin));
        }
        ASSERT_TRUE(drivers::write_frame(folder_ / (name + "_raw.png"), frame.view()));
        std::ofstream(folder_ / (name + ".json")) << notes;
    }
    std::filesystem::path folder_;
};

TEST_F(LightFields, are_sorted_into_good_parts_and_flaws_of_each_family) {
    write("lens_pose00", R"({"part": "lens", "angular": 5, "defect_free": true})");
    write("lens_cut0", R"({"part": "lens", "angular": 5, "centre_lenslet": [3.5, 4], "radius_lenslets": 0.8})");
    write("plate_pose00", R"({"part": "plate", "angular": 5, "defect_free": true})");
    const auto families = read_light_fields(folder_);
    ASSERT_TRUE(families) << families.error().message();
    ASSERT_EQ(families->size(), 2U);
    const TracedFamily& lens = families->at("lens");
    ASSERT_EQ(lens.good.size(), 1U);
    ASSERT_EQ(lens.flawed.size(), 1U);
    EXPECT_EQ(lens.good.front().extents, (algo::Extents{kLenslets, kLenslets, kBins, kBins}));
    EXPECT_EQ(lens.good.front().light.front(), 1.0F);
    EXPECT_EQ(lens.flawed.front().flaw->m, 3.5);
    EXPECT_EQ(lens.flawed.front().flaw->radius, 0.8);
}

// A defect anywhere along a scratch has found it.
TEST_F(LightFields, have_scratches_with_a_length) {
    write("plate_scratch1", R"({"part": "plate", "angular": 5, "centre_lenslet": [10, 8], "radius_lenslets": 0.04,
        "length_lenslets": 10, "defect": {"type": "scratch", "deg": 30}})");
    const auto families = read_light_fields(folder_);
    ASSERT_TRUE(families) << families.error().message();
    const TracedFlaw& scratch = *families->at("plate").flawed.front().flaw;
    const double c = std::cos(scratch.angle), s = std::sin(scratch.angle);
    EXPECT_NEAR(c, std::sqrt(0.75), 1e-12);
    EXPECT_NEAR(scratch.distance(10 + 5 * c, 8 + 5 * s), 0, 1e-12);  // its end
    EXPECT_NEAR(scratch.distance(10 + 7 * c, 8 + 7 * s), 2, 1e-12);
    EXPECT_NEAR(scratch.distance(10 - 3 * c - 2 * s, 8 - 3 * s + 2 * c), 2, 1e-12);
}

TEST_F(LightFields, that_cannot_be_used_are_refused_with_the_file) {
    EXPECT_FALSE(read_light_fields(folder_));
    write("lens_cut0", R"({"part": "lens", "angular": 5})");  // a flaw without a place
    const auto families = read_light_fields(folder_);
    ASSERT_FALSE(families);
    EXPECT_NE(families.error().message().find("lens_cut0.json"), std::string::npos);
}

// Mean and relative standard deviation of the lenslets' light.
std::pair<double, double> light_of(const TracedPart& part, const Exposure& exposure) {
    const Frame frame = expose(part, exposure);
    double sum = 0, squares = 0;
    for (int n = 0; n < kLenslets; ++n) {
        for (int m = 0; m < kLenslets; ++m) {
            double light = 0;
            for (int b = 0; b < kBins * kBins; ++b)
                light += frame.view().sample(m * kBins + b % kBins, n * kBins + b / kBins);
            sum += light, squares += light * light;
        }
    }
    const double mean = sum / (kLenslets * kLenslets);
    return {mean / (kBins * kBins), std::sqrt(squares / (kLenslets * kLenslets) / (mean * mean) - 1)};
}

TEST_F(LightFields, have_photon_noise_and_ripple_when_exposed) {
    write("lens_pose00", R"({"part": "lens", "angular": 5, "defect_free": true})");
    const auto families = read_light_fields(folder_);
    ASSERT_TRUE(families);
    const TracedPart& part = families->at("lens").good.front();
    const double electrons = 10'000, photons = 1 / std::sqrt(electrons * kBins * kBins);
    const auto [mean, noise] = light_of(part, {12, electrons, 0.5, Ripple::none, 1});
    EXPECT_NEAR(mean, 0.5 * 240.0 / 255 * 4095, 2);
    EXPECT_NEAR(noise, photons * std::sqrt(2), 0.15 * photons);  // 400 lenslets: 3.5 %, four standard deviations
    for (const Ripple ripple : {Ripple::sensor, Ripple::part})
        EXPECT_NEAR(light_of(part, {12, electrons, 1, ripple, 1}).second, kRippleShare, 0.15 * kRippleShare);
}

}  // namespace
}  // namespace hord::lab
