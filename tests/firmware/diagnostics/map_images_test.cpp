// Image files contain exactly the pixels that were drawn.
#include "firmware/diagnostics/map_images.h"

#include <algorithm>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using testing::HasSubstr;
using testing_support::TempFolder;

constexpr algo::Extents kExtents{.m = 40, .n = 30, .i = 9, .j = 9};

struct Sample {
    std::vector<float> map;
    std::vector<std::uint8_t> mask;
};
Sample sample() {
    Sample s;
    for (int k = 0; k < kExtents.m * kExtents.n; ++k) {
        s.map.push_back(static_cast<float>(k % 97) * 0.013F - 0.2F);
        s.mask.push_back(k % 11 == 0 ? algo::kDark : k % 7 == 0 ? algo::kSaturated : algo::kValid);
    }
    return s;
}
Picture drawn(const Sample& s) {
    algo::Defect defect;
    defect.m = 12;
    defect.n = 9;
    defect.area = 5;
    return draw(scale_to("EMD", "bins", s.map, s.mask, 0.5F), s.map, s.mask, kExtents, std::span(&defect, 1), {},
                "a caption");
}

bool same(const cv::Mat& image, const Picture& picture) {
    return image.type() == CV_8UC3 && image.cols == picture.width && image.rows == picture.height &&
        image.isContinuous() && std::memcmp(image.data, picture.bgr.data(), picture.bgr.size()) == 0;
}

TEST(Pictures, a_png_holds_the_pixels_that_were_drawn) {
    const TempFolder folder;
    const Picture picture = drawn(sample());
    const auto bytes = encode_png(picture);
    ASSERT_TRUE(bytes) << bytes.error().message();
    EXPECT_TRUE(same(cv::imdecode(*bytes, cv::IMREAD_UNCHANGED), picture));
    const auto file = folder.path() / "map.png";
    ASSERT_TRUE(write_png(file, picture));
    EXPECT_EQ(TempFolder::read(file), std::string(bytes->begin(), bytes->end()));
}

TEST(Pictures, a_defect_is_ringed_in_red_not_in_blue) {
    const auto bytes = encode_png(drawn(sample()));
    ASSERT_TRUE(bytes);
    const cv::Mat image = cv::imdecode(*bytes, cv::IMREAD_COLOR);
    int red = 0, blue = 0;
    for (int y = 0; y < image.rows; ++y) {
        for (int x = 0; x < image.cols; ++x) {
            const auto& pixel = image.at<cv::Vec3b>(y, x);
            red += pixel == cv::Vec3b(40, 40, 230) ? 1 : 0;
            blue += pixel == cv::Vec3b(230, 40, 40) ? 1 : 0;
        }
    }
    EXPECT_GT(red, 20);
    EXPECT_EQ(blue, 0);
}

TEST(Pictures, a_float_map_is_read_back_equal) {
    const TempFolder folder;
    const auto file = folder.path() / "map.tiff";
    const Sample s = sample();
    ASSERT_TRUE(write_float_tiff(file, s.map, kExtents));
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(image.type(), CV_32FC1);
    ASSERT_EQ(image.size(), cv::Size(kExtents.m, kExtents.n));
    EXPECT_EQ(std::memcmp(image.data, s.map.data(), s.map.size() * sizeof(float)), 0);
}

TEST(Pictures, what_cannot_be_written_is_named_with_its_cure_and_leaves_nothing) {
    const TempFolder folder;
    const Sample s = sample();
    for (const auto& done : {write_png(folder.path() / "no" / "map.png", drawn(s)),
                             write_float_tiff(folder.path() / "no" / "map.tiff", s.map, kExtents)}) {
        ASSERT_FALSE(done);
        EXPECT_EQ(done.error().code, ErrorCode::not_found);
        EXPECT_THAT(done.error().what, HasSubstr((folder.path() / "no").string()));
        EXPECT_FALSE(done.error().cure.empty());
    }
    EXPECT_EQ(write_png(folder.path() / "empty.png", Picture{}).error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace hord::firmware
