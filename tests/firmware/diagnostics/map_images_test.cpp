// Image files contain exactly the pixels that were drawn.
#include "firmware/diagnostics/map_images.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "firmware/diagnostics/map_files.h"
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

// What is drawn for a defect lies inside the box that is told, and reaches its edges.
TEST(Pictures, the_mark_of_a_defect_takes_the_pixels_that_are_told) {
    const Sample s = sample();
    const MapPicture what = scale_to("EMD", "bins", s.map, s.mask, 0.5F);
    const Picture plain = draw(what, s.map, s.mask, kExtents, {});
    for (const float m : {1.0F, static_cast<float>(kExtents.m) - 2.0F}) {
        const std::vector<algo::Defect> defects{{.m = m, .n = 4, .area = 3}};
        const std::vector<std::string> labels{"scratch 8.4 lenslets"};
        const Picture marked = draw(what, s.map, s.mask, kExtents, defects, labels);
        const PictureBox box = mark_in_picture(kExtents, defects, labels, 0);
        int left = marked.width, top = marked.height, right = 0, bottom = 0;
        for (int y = 0; y < marked.height; ++y) {
            for (int x = 0; x < marked.width; ++x) {
                const auto at = static_cast<std::size_t>(3 * (y * marked.width + x));
                if (std::equal(&marked.bgr[at], &marked.bgr[at] + 3, &plain.bgr[at])) continue;
                left = std::min(left, x), top = std::min(top, y);
                right = std::max(right, x + 1), bottom = std::max(bottom, y + 1);
            }
        }
        ASSERT_LT(left, right);
        EXPECT_LE(box.x, left);
        EXPECT_LE(box.y, top);
        EXPECT_GE(box.x + box.width, right);
        EXPECT_GE(box.y + box.height, bottom);
        EXPECT_LE(left - box.x, 45) << "beyond the map's edge at most";
        EXPECT_LE(box.x + box.width - right, 45);
    }
}

// Defects at one place: what is drawn of the earlier ones stays.
TEST(Pictures, labels_do_not_cover_each_other) {
    const auto red = [](const unsigned char* bgr) { return bgr[0] < 140 && bgr[1] < 140 && bgr[2] > 180; };
    const Sample s = sample();
    const MapPicture what = scale_to("EMD", "bins", s.map, s.mask, 0.5F);
    for (const float m : {12.0F, static_cast<float>(kExtents.m) - 5.0F}) {
        const std::vector<algo::Defect> defects(5, {.m = m, .n = 9, .area = 1});
        const std::vector<std::string> labels(5, "scratch 8.4 lenslets");
        const Picture plain = draw(what, s.map, s.mask, kExtents, {});
        Picture before = plain;
        for (std::size_t count = 1; count <= defects.size(); ++count) {
            const Picture now = draw(what, s.map, s.mask, kExtents, std::span(defects).first(count), labels);
            std::size_t covered = 0, fresh = 0;  // pixels of the marks' colour
            for (std::size_t k = 0; k < plain.bgr.size(); k += 3) {
                const bool was = red(&before.bgr[k]), is = red(&now.bgr[k]);
                covered += was && !is ? 1U : 0U;
                fresh += is && !was ? 1U : 0U;
            }
            EXPECT_EQ(covered, 0U) << count;
            EXPECT_GT(fresh, 100U) << count << " has no label of its own";
            before = now;
        }
    }
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

TEST(Pictures, a_lenslet_without_a_value_is_NaN_in_the_file) {
    const TempFolder folder;
    const Sample s = sample();
    FeatureView view{.name = "emd", .map = s.map};
    view.mask = s.mask;
    ASSERT_TRUE(write_float_tiff(folder.path() / "map.tiff", view, kExtents));
    const cv::Mat image = cv::imread((folder.path() / "map.tiff").string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(image.type(), CV_32FC1);
    for (std::size_t k = 0; k < s.map.size(); ++k) {
        const float value = image.at<float>(static_cast<int>(k) / kExtents.m, static_cast<int>(k) % kExtents.m);
        if (s.mask[k] == algo::kValid) {
            EXPECT_EQ(value, s.map[k]);
        } else {
            EXPECT_TRUE(std::isnan(value)) << k;
        }
    }
}

TEST(Pictures, a_mask_has_a_colour_a_reason_and_names_its_bits) {
    const TempFolder folder;
    const Sample s = sample();
    FeatureView view{.name = "emd", .map = s.map};
    std::vector<std::uint8_t> mask(s.mask.size());
    for (unsigned bit = 0; bit < 6; ++bit) mask[bit] = static_cast<std::uint8_t>(1U << bit);
    mask[6] = algo::kRim | algo::kDark;
    view.mask = mask;
    const auto file = folder.path() / "a.mask.png";
    ASSERT_TRUE(write_mask_png(file, view, kExtents));
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_COLOR);
    ASSERT_EQ(image.size(), cv::Size(kExtents.m, kExtents.n));
    for (int a = 0; a < 6; ++a) {
        for (int b = 0; b < a; ++b) EXPECT_NE(image.at<cv::Vec3b>(0, a), image.at<cv::Vec3b>(0, b)) << a << " " << b;
        EXPECT_NE(image.at<cv::Vec3b>(0, a), image.at<cv::Vec3b>(0, 7)) << a;  // of a lenslet that is judged
    }
    EXPECT_EQ(image.at<cv::Vec3b>(0, 6), image.at<cv::Vec3b>(0, 0));  // dark, whatever else
    const std::string bytes = TempFolder::read(file);
    EXPECT_THAT(bytes, HasSubstr("hord-mask"));
    EXPECT_THAT(bytes, HasSubstr(R"("feature":"emd")"));
    EXPECT_THAT(bytes, HasSubstr(R"("at-limit":32)"));
    EXPECT_THAT(bytes, HasSubstr(R"("no_value":7)"));
}

// The pixels of two pictures that differ, in the rows that both have.
std::vector<cv::Point> differences(const Picture& a, const Picture& b) {
    std::vector<cv::Point> out;
    for (int y = 0; y < std::min(a.height, b.height); ++y) {
        for (int x = 0; x < std::min(a.width, b.width); ++x) {
            const auto at = 3 * static_cast<std::size_t>(y * a.width + x);
            if (!std::equal(a.bgr.data() + at, a.bgr.data() + at + 3, b.bgr.data() + at)) out.emplace_back(x, y);
        }
    }
    return out;
}
bool is_grey(const Picture& picture, const cv::Point& p) {
    const auto at = 3 * static_cast<std::size_t>(p.y * picture.width + p.x);
    return picture.bgr[at] == picture.bgr[at + 1] && picture.bgr[at] == picture.bgr[at + 2];
}
std::size_t red_pixels(const Picture& picture) {
    std::size_t count = 0;
    for (std::size_t at = 0; at < picture.bgr.size(); at += 3)
        count += picture.bgr[at] == 40 && picture.bgr[at + 1] == 40 && picture.bgr[at + 2] == 230 ? 1 : 0;
    return count;
}

// 40 lenslets are enlarged 12 times: 480 pixels.
TEST(Pictures, no_data_is_hatched_grey_which_no_value_is) {
    std::vector<float> map(kExtents.lenslets());
    for (std::size_t k = 0; k < map.size(); ++k) map[k] = static_cast<float>(k) / static_cast<float>(map.size());
    std::vector<std::uint8_t> mask(kExtents.lenslets());
    const MapPicture what{"EMD", "bins", 0, 1};
    const Picture whole = draw(what, map, mask, kExtents, {});
    const std::size_t k = kExtents.index(20, 15);
    const float value = map[k];
    for (const std::uint8_t bits : {algo::kDark, algo::kSaturated, algo::kBorder, algo::kValid}) {
        mask[k] = bits;
        map[k] = bits == algo::kValid ? std::nanf("") : value;
        const Picture holed = draw(what, map, mask, kExtents, {});
        const auto changed = differences(whole, holed);
        std::size_t in_map = 0;
        for (const cv::Point& p : changed) {
            if (p.y >= 26 + 360) continue;  // the legend
            ++in_map;
            EXPECT_TRUE(is_grey(holed, p));
            EXPECT_FALSE(is_grey(whole, p));
        }
        EXPECT_EQ(in_map, 144U) << int{bits};
        EXPECT_GT(holed.height, whole.height) << "a legend explains it";
    }
    map[k] = value;
    mask[k] = algo::kRim;  // a value that is not judged keeps its colour, dimmed
    const Picture dimmed = draw(what, map, mask, kExtents, {});
    const auto changed = differences(whole, dimmed);
    ASSERT_GE(changed.size(), 144U);
    EXPECT_FALSE(is_grey(dimmed, changed.front()));
}

// As a camera shows it: no colour, no hatching, nothing dimmed, whatever is judged.
TEST(Pictures, light_is_grey_from_black_to_white) {
    std::vector<std::uint32_t> sums(kExtents.lenslets());
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] = static_cast<std::uint32_t>(k);
    std::vector<std::uint8_t> mask(kExtents.lenslets(), algo::kRim);
    mask[0] = algo::kDark;
    mask[1] = algo::kOutside;
    std::ranges::fill(std::span(mask).subspan(2, 100), algo::kValid);
    mask.back() = algo::kSaturated;
    algo::Inspection found;
    found.verdict = algo::Verdict::unfit;
    found.sums = sums;
    found.mask = mask;
    const algo::Recipe recipe{};
    const FeatureViews views(found, recipe, kExtents);
    MapPicture what = scale_to("light", *views.find(kSums), recipe);
    what.low = 0;
    what.high = static_cast<float>(sums.size() - 1);
    const Picture picture = draw(what, views.find(kSums)->map, views.find(kSums)->mask, kExtents, {});
    const auto pixel = [&](int m, int n) { return cv::Point(40 + 12 * m + 6, 26 + 12 * n + 6); };
    int before = -1;
    for (int n = 0; n < kExtents.n; ++n) {
        for (int m = 0; m < kExtents.m; ++m) {
            const cv::Point at = pixel(m, n);
            const int level = picture.bgr[3 * static_cast<std::size_t>(at.y * picture.width + at.x)];
            ASSERT_TRUE(is_grey(picture, at)) << m << ' ' << n;
            ASSERT_GE(level, before) << m << ' ' << n;
            before = level;
        }
    }
    EXPECT_EQ(before, 255);
    EXPECT_EQ(picture.height, 26 + 360 + 34) << "no legend: there is nothing to explain";
}

TEST(Pictures, the_limit_is_marked_on_the_scale) {
    const Sample s = sample();
    MapPicture what{"EMD", "bins", 0, 1};
    EXPECT_EQ(red_pixels(draw(what, s.map, s.mask, kExtents, {})), 0U);
    what.limit = 0.4F;
    EXPECT_GT(red_pixels(draw(what, s.map, s.mask, kExtents, {})), 15U);
    EXPECT_EQ(scale_to("EMD", "bins", s.map, s.mask, 0.5F).limit, 0.5F);
}

TEST(Pictures, say_when_not_all_defects_are_marked) {
    const Sample s = sample();
    std::vector<algo::Defect> defects(20);
    const Picture all = draw({"EMD", "bins", 0, 1}, s.map, s.mask, kExtents, defects);
    defects.resize(53);
    const Picture some = draw({"EMD", "bins", 0, 1}, s.map, s.mask, kExtents, defects);
    ASSERT_EQ(some.height, all.height + 18);  // a line of text
    const auto line = some.bgr.begin() + 3 * static_cast<std::ptrdiff_t>(some.width) * all.height;
    EXPECT_GT(std::count_if(line, some.bgr.end(), [](unsigned char value) { return value < 200; }), 100);
}

TEST(Pictures, axes_count_lenslets_or_mm) {
    const Sample s = sample();
    MapPicture what{"EMD", "bins", 0, 1};
    const Picture lenslets = draw(what, s.map, s.mask, kExtents, {});
    what.first_m = 100;
    const Picture later = draw(what, s.map, s.mask, kExtents, {});
    what.first_m = 0;
    what.lenslet_mm = 0.2F;
    const Picture mm = draw(what, s.map, s.mask, kExtents, {});
    for (const Picture* other : {&later, &mm}) {
        const auto changed = differences(lenslets, *other);
        EXPECT_GT(changed.size(), 50U);
        // Only outside of the map: left of it or below it.
        for (const cv::Point& p : changed) EXPECT_TRUE(p.x < 40 || p.y >= 26 + 360) << p.x << " " << p.y;
    }
}

// Legible where a figure of many of them is shown at a fraction of its size.
TEST(Pictures, of_a_figure_have_large_letters_and_neither_axes_nor_legend) {
    const Sample s = sample();
    MapPicture what{"EMD", "", 0, 1};
    const Picture plain = draw(what, s.map, s.mask, kExtents, {});
    what.axes = false;
    const Picture bare = draw(what, s.map, s.mask, kExtents, {});
    EXPECT_EQ(bare.width, plain.width - 40 - 42);  // nor room for a limit beside the scale
    EXPECT_EQ(bare.height, 26 + 30 * 12);          // the title and the map
    what.letters = 2.5F;
    const Picture large = draw(what, s.map, s.mask, kExtents, {});
    EXPECT_EQ(large.height, 65 + 30 * 12);
    const auto rows_of_title = [](const Picture& picture, int rows) {
        int inked = 0;
        for (int y = 0; y < rows; ++y) {
            const auto row = picture.bgr.begin() + 3 * static_cast<std::ptrdiff_t>(picture.width) * y;
            inked += std::any_of(row, row + 3 * 300, [](unsigned char value) { return value < 128; }) ? 1 : 0;
        }
        return inked;
    };
    EXPECT_GE(rows_of_title(large, 65), 2 * rows_of_title(bare, 26));
}

TEST(Pictures, of_a_montage_lie_in_columns) {
    Picture narrow{10, 5, std::vector<unsigned char>(3 * 10 * 5, 0)},
        wide{30, 5, std::vector<unsigned char>(3 * 30 * 5, 0)};
    const std::vector<MontageRow> rows{{"", {narrow, narrow}}, {"", {wide, narrow}}};
    const Picture sheet = montage(rows);
    const auto black_from = [&](int y) {  // the first black pixel of a row after its first picture
        int x = 118 + 31;
        while (x < sheet.width && sheet.bgr[3 * static_cast<std::size_t>(y * sheet.width + x)] != 0) ++x;
        return x;
    };
    EXPECT_LT(black_from(10), sheet.width);
    EXPECT_EQ(black_from(10), black_from(23));
}

TEST(Pictures, what_cannot_be_written_is_named_with_its_cure_and_leaves_nothing) {
    const TempFolder folder;
    const Sample s = sample();
    for (const auto& done : {write_png(folder.path() / "no" / "map.png", drawn(s)),
                             write_float_tiff(folder.path() / "no" / "map.tiff", s.map, kExtents),
                             write_mask_png(folder.path() / "no" / "map.png",
                                            FeatureView{.name = "emd", .map = s.map, .mask = s.mask}, kExtents)}) {
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
