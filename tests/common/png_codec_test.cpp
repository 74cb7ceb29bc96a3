// The PNG codec, against OpenCV and libpng.
#include "common/png_codec.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <png.h>
#include <zlib.h>

#include "tests/common/image_frames.h"

namespace hord::common {
namespace {

using testing::HasSubstr;

// A PNG as another program may write it: interlaced if `interlace` says so, with optional chunks if `talkative`.
Bytes foreign_png(const Frame& frame, int interlace, bool talkative) {
    Bytes out;
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_set_write_fn(
        png, &out,
        [](png_structp to, png_bytep bytes, std::size_t count) {
            auto& all = *static_cast<Bytes*>(png_get_io_ptr(to));
            all.insert(all.end(), bytes, bytes + count);
        },
        nullptr);
    png_set_IHDR(png, info, static_cast<png_uint_32>(frame.width_px()), static_cast<png_uint_32>(frame.height_px()),
                 frame.bits() > 8 ? 16 : 8, PNG_COLOR_TYPE_GRAY, interlace, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    if (talkative) {
        png_set_gAMA(png, info, 2.2);
        png_set_pHYs(png, info, 3, 4, PNG_RESOLUTION_METER);
        const png_color_8 depth{
            .red = 0, .green = 0, .blue = 0, .gray = static_cast<png_byte>(frame.bits() > 8 ? 12 : 8), .alpha = 0};
        png_set_sBIT(png, info, &depth);
        const png_color_16 dark{.index = 0, .red = 0, .green = 0, .blue = 0, .gray = 7};
        png_set_tRNS(png, info, nullptr, 0, &dark);
        std::string text(2000, 'x');
        png_text note{};
        note.compression = PNG_TEXT_COMPRESSION_zTXt;
        note.key = const_cast<char*>("Comment");
        note.text = text.data();
        note.text_length = text.size();
        png_set_text(png, info, &note, 1);
    }
    png_write_info(png, info);
    if (frame.bits() > 8) png_set_swap(png);
    std::vector<png_bytep> rows;
    const auto row_bytes = static_cast<std::size_t>(frame.view().stride_bytes);
    for (std::size_t y = 0; y < static_cast<std::size_t>(frame.height_px()); ++y) {
        rows.push_back(reinterpret_cast<png_bytep>(const_cast<std::byte*>(frame.bytes().data())) + y * row_bytes);
    }
    png_write_image(png, rows.data());
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    return out;
}

TEST(PngCodec, reads_what_others_write_interlaced_or_not_and_whatever_they_say_beside_it) {
    for (const int bits : {8, 16}) {
        for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7}) {
            for (const bool talkative : {false, true}) {
                const auto frame = pattern(37, 23, bits);
                const Bytes file = foreign_png(frame, interlace, talkative);
                const auto read = decode_grey_png(file, "f.png");
                ASSERT_TRUE(read) << read.error().message();
                EXPECT_TRUE(same(read->frame, frame))
                    << bits << " bits, interlace " << interlace << ", talkative " << talkative;
                EXPECT_EQ(read->frame.bits(), bits);  // sBIT is ignored: no note was requested
                EXPECT_EQ(read->length, file.size());
                EXPECT_TRUE(same(read->frame, decoded(file)));
            }
        }
    }
}

TEST(PngCodec, writes_what_opencv_reads_as_the_same_samples) {
    for (const int bits : {8, 12, 16}) {
        const auto frame = pattern(37, 23, bits);
        for (const bool runs_only : {true, false}) {
            for (const bool noted : {true, false}) {
                const auto file = encode_grey_png(frame.view(), {.level = 3, .runs_only = runs_only},
                                                  noted ? std::optional(PngNote{"hord", "µ"}) : std::nullopt);
                ASSERT_TRUE(file) << file.error().message();
                EXPECT_TRUE(same(frame, decoded(*file))) << bits;
                EXPECT_EQ(decode_grey_png(*file, "f.png", "hord")->note,
                          noted ? std::optional<std::string>("µ") : std::nullopt);
                EXPECT_EQ(decode_grey_png(*file, "f.png", "other")->note, std::nullopt);
            }
        }
    }
}

TEST(PngCodec, reads_what_opencv_writes) {
    for (const int bits : {8, 16}) {
        const auto frame = pattern(301, 97, bits);
        const cv::Mat image(frame.height_px(), frame.width_px(), bits > 8 ? CV_16UC1 : CV_8UC1,
                            const_cast<std::byte*>(frame.bytes().data()));
        Bytes theirs;
        ASSERT_TRUE(cv::imencode(".png", image, theirs));
        const auto read = decode_grey_png(theirs, "theirs.png");
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_TRUE(same(read->frame, frame));
    }
}

TEST(PngCodec, colour_is_blue_green_red_as_in_opencv) {
    Bytes bgr;
    for (int k = 0; k < 5 * 3; ++k)
        bgr.insert(bgr.end(),
                   {static_cast<std::uint8_t>(10 + k), static_cast<std::uint8_t>(100 + k),
                    static_cast<std::uint8_t>(200 + k)});
    const auto file = encode_bgr_png(5, 3, bgr);
    ASSERT_TRUE(file) << file.error().message();
    const cv::Mat image = decoded(*file);
    ASSERT_EQ(image.type(), CV_8UC3);
    ASSERT_EQ(image.size(), cv::Size(5, 3));
    EXPECT_EQ(Bytes(image.datastart, image.dataend), bgr);
    // In the file red comes first: libpng reads the same pixels as RGB.
    png_image plain{};
    plain.version = PNG_IMAGE_VERSION;
    ASSERT_TRUE(png_image_begin_read_from_memory(&plain, file->data(), file->size()));
    plain.format = PNG_FORMAT_RGB;
    Bytes rgb(PNG_IMAGE_SIZE(plain));
    ASSERT_TRUE(png_image_finish_read(&plain, nullptr, rgb.data(), 0, nullptr));
    EXPECT_EQ(rgb[0], 200);
    EXPECT_EQ(rgb[1], 100);
    EXPECT_EQ(rgb[2], 10);
}

TEST(PngCodec, refuses_what_it_cannot_encode) {
    const Bytes bgr(5 * 3 * 3);
    for (const auto& [width, height] : {std::pair{5, 4}, {0, 3}, {5, 0}, {-5, -3}}) {
        const auto file = encode_bgr_png(width, height, bgr);
        ASSERT_FALSE(file);
        EXPECT_EQ(file.error().code, ErrorCode::invalid_argument);
    }
    EXPECT_EQ(encode_grey_png({}).error().code, ErrorCode::invalid_argument);
}

TEST(PngCodec, colour_and_small_depths_are_refused_by_name) {
    Bytes file;
    ASSERT_TRUE(cv::imencode(".png", cv::Mat(4, 4, CV_8UC3, cv::Scalar(1, 2, 3)), file));
    const auto read = decode_grey_png(file, "colour.png");
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::unsupported);
    EXPECT_THAT(read.error().what, testing::AllOf(HasSubstr("colour.png"), HasSubstr("not a grey frame")));
}

void put_big_endian(Bytes& file, std::size_t at, std::uint32_t value) {
    for (unsigned k = 0; k < 4; ++k) file[at + k] = static_cast<std::uint8_t>(value >> (24 - 8 * k));
}

TEST(PngCodec, takes_no_memory_that_the_file_cannot_fill) {
    Bytes file = *encode_grey_png(pattern(8, 8, 16).view());
    for (const auto& [side, why] :
         {std::pair{30'000U, "more than 200000000 samples"}, {14'000U, "too short for the size"}}) {
        put_big_endian(file, 16, side);  // width and height
        put_big_endian(file, 20, side);
        put_big_endian(file, 29, static_cast<std::uint32_t>(crc32(0, file.data() + 12, 17)));
        const auto read = decode_grey_png(file, "huge.png");
        ASSERT_FALSE(read);
        EXPECT_THAT(read.error().what, HasSubstr(why));
    }
    file = *encode_grey_png(pattern(8, 8, 16).view(), {}, PngNote{"hord", "text"});
    const std::string_view name = "iTXt";
    const auto note = std::search(file.begin(), file.end(), name.begin(), name.end());
    put_big_endian(file, static_cast<std::size_t>(note - file.begin()) - 4, 800'000'000);
    const auto noted = decode_grey_png(file, "noted.png", "hord");
    ASSERT_FALSE(noted);
    // The size is refused before memory is allocated. A libpng newer than Debian 12's skips a chunk that is too large
    // and reports the file as cut off.
    EXPECT_THAT(noted.error().what, HasSubstr(PNG_LIBPNG_VER > 10639 ? "cut off" : "too large"));
    // A frame with the highest compression ratio is still read.
    const Frame dark(3000, 2000, 16);
    for (const int level : {1, 9})
        EXPECT_TRUE(same(decode_grey_png(*encode_grey_png(dark.view(), {.level = level}), "dark.png")->frame, dark));
}

// -- TIFF

// Indexes, palette and text as another program reads them.
struct ForeignPalette {
    std::vector<std::uint8_t> indexes;
    std::vector<png_color> palette;
    std::string keyword, text;
};
ForeignPalette read_palette(const Bytes& bytes) {
    ForeignPalette out;
    std::size_t at = 0;
    std::pair source{&bytes, &at};
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_set_read_fn(png, &source, [](png_structp from, png_bytep to, std::size_t count) {
        auto& [all, place] = *static_cast<std::pair<const Bytes*, std::size_t*>*>(png_get_io_ptr(from));
        std::memcpy(to, all->data() + *place, count);
        *place += count;
    });
    png_read_info(png, info);
    EXPECT_EQ(png_get_color_type(png, info), PNG_COLOR_TYPE_PALETTE);
    EXPECT_EQ(png_get_bit_depth(png, info), 8);
    const auto width = png_get_image_width(png, info), height = png_get_image_height(png, info);
    out.indexes.resize(std::size_t{width} * height);
    for (std::size_t y = 0; y < height; ++y) png_read_row(png, out.indexes.data() + y * width, nullptr);
    png_read_end(png, info);
    png_colorp colours = nullptr;
    int count = 0;
    png_get_PLTE(png, info, &colours, &count);
    out.palette.assign(colours, colours + count);
    png_textp texts = nullptr;
    if (png_get_text(png, info, &texts, nullptr) == 1) {
        out.keyword = texts[0].key;
        out.text = texts[0].text;
    }
    png_destroy_read_struct(&png, &info, nullptr);
    return out;
}

TEST(Png, of_indexes_keeps_indexes_palette_and_note) {
    const Bytes indexes{0, 1, 2, 2, 1, 0};
    const PngColour palette[] = {{1, 2, 3}, {40, 50, 60}, {255, 254, 253}};
    const auto bytes = encode_index_png(3, 2, indexes, palette, PngNote{"hord-mask", "what it is"});
    ASSERT_TRUE(bytes) << bytes.error().message();
    const ForeignPalette read = read_palette(*bytes);
    EXPECT_EQ(read.indexes, indexes);
    ASSERT_EQ(read.palette.size(), 3U);
    EXPECT_EQ(read.palette[2].red, 255);
    EXPECT_EQ(read.palette[2].blue, 253);
    EXPECT_EQ(read.keyword, "hord-mask");
    EXPECT_EQ(read.text, "what it is");
    EXPECT_EQ(encode_index_png(3, 2, Bytes{0, 1, 2, 2, 1, 3}, palette).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(encode_index_png(2, 2, indexes, palette).error().code, ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace hord::common
