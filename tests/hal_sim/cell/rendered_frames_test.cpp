#include "hal_sim/cell/rendered_frames.h"

#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::sim {
namespace {

Scene small(const char* name) {
    Scene scene;
    scene.name = name;
    scene.camera.extents = {12, 12, 5, 5};
    scene.part = DoubleConvexLens{};
    return scene;
}

class Rendered : public testing::Test {
  protected:
    static RenderedFrames& frames() {
        static const std::unique_ptr<RenderedFrames> made = [] {
            Scene bad = small("speck");
            bad.defects.push_back(AbsorbingSpeck{.centre_mm = {0, 0, 0}, .radius_mm = 3, .transmission = 0});
            auto result = RenderedFrames::make({small("good"), bad},
                                               {.exposures = 2, .nominal_share = 0.02, .seed = 1, .progress = {}});
            EXPECT_TRUE(result) << result.error().message();
            return std::move(*result);
        }();
        return *made;
    }
    // Light in lenslets [first, last] of the middle row.
    double light(const Exposure& exposure, int first, int last) {
        std::vector<std::byte> scratch(60 * 60);
        const auto view = frames().expose(exposure, scratch);
        double sum = 0;
        for (int y = 6 * 5; y < 7 * 5; ++y) {
            for (int x = first * 5; x < (last + 1) * 5; ++x) sum += view.sample(x, y);
        }
        return sum;
    }
};

TEST_F(Rendered, a_kind_shows_its_own_scene_and_no_part_the_empty_field) {
    EXPECT_EQ(frames().format().width_px, 60);
    EXPECT_EQ(light({.kind = 1}, 6, 6), 0);
    EXPECT_GT(light({.kind = 0}, 6, 6), 0);
    EXPECT_GT(light({}, 0, 11), 0);
}

TEST_F(Rendered, light_scales_the_frame_and_none_makes_it_dark) {
    EXPECT_EQ(light({.kind = 0, .light = 0}, 0, 11), 0);
    const double nominal = light({.kind = 0}, 6, 6);
    EXPECT_NEAR(light({.kind = 0, .light = 0.5}, 6, 6), nominal / 2, 0.05 * nominal);
}

TEST_F(Rendered, nominal_frames_are_lent_not_copied) {
    std::vector<std::byte> scratch(60 * 60);
    EXPECT_NE(frames().expose({.kind = 0, .seed = 3}, scratch).data, scratch.data());
    EXPECT_EQ(frames().expose({.kind = 0, .seed = 3}, scratch).data,
              frames().expose({.kind = 0, .seed = 5}, scratch).data);
    EXPECT_EQ(frames().expose({.kind = 0, .light = 0.5}, scratch).data, scratch.data());
}

TEST_F(Rendered, a_part_past_the_centre_is_seen_shifted_along_the_belt) {
    const double pitch_mm = 24.0 / 12;
    const Exposure shifted{.kind = 1, .offset_mm = 3 * pitch_mm};
    EXPECT_EQ(light(shifted, 9, 9), 0);
    EXPECT_GT(light(shifted, 6, 6), 0);
}

TEST_F(Rendered, scenes_with_different_cameras_are_refused) {
    Scene other = small("other");
    other.camera.bits = 12;
    const auto made = RenderedFrames::make({small("one"), other});
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::invalid_argument);
    EXPECT_THAT(made.error().what, testing::HasSubstr("other"));
    EXPECT_FALSE(RenderedFrames::make({}));
}

}  // namespace
}  // namespace hord::sim
