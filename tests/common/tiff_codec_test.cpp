// The TIFF codec, against OpenCV and libtiff.
#include "common/tiff_codec.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/resource.h>
#include <tiffio.h>

#include "tests/common/image_frames.h"
#include "tests/support/temp_folder.h"

namespace hord::common {
namespace {

using testing::HasSubstr;
using testing_support::TempFolder;

struct Layout {
    const char* mode = "wl";  // mode of TIFFOpen: wl is little-endian, wb big-endian
    int packing = COMPRESSION_NONE;
    int predictor = PREDICTOR_NONE;
    std::uint32_t rows = 5;  // per strip
    std::uint32_t tile = 0;  // side of a tile, px; 0: strips
    int orientation = ORIENTATION_TOPLEFT;
};

std::string text_of(const Layout& layout) {
    return std::string(layout.mode) + ", packing " + std::to_string(layout.packing) + ", predictor " +
        std::to_string(layout.predictor) + ", rows " + std::to_string(layout.rows) + ", tile " +
        std::to_string(layout.tile) + ", orientation " + std::to_string(layout.orientation);
}

Bytes tiff_of(const Frame& frame, const Layout& layout) {
    const TempFolder folder;
    const auto path = folder.path() / "f.tiff";
    TIFF* tiff = TIFFOpen(path.c_str(), layout.mode);
    EXPECT_NE(tiff, nullptr);
    const auto width = static_cast<std::uint32_t>(frame.width_px()),
               height = static_cast<std::uint32_t>(frame.height_px());
    const std::uint32_t sample = frame.bits() > 8 ? 2 : 1;
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8 * sample);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_ORIENTATION, layout.orientation);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, layout.packing);
    if (layout.predictor != PREDICTOR_NONE) TIFFSetField(tiff, TIFFTAG_PREDICTOR, layout.predictor);
    // libtiff may modify the samples that it encodes, so it gets a copy.
    std::vector<std::byte> samples(frame.bytes().begin(), frame.bytes().end());
    if (layout.tile == 0) {
        TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, layout.rows);
        for (std::uint32_t y = 0; y < height; ++y)
            EXPECT_EQ(TIFFWriteScanline(tiff, samples.data() + std::size_t{y} * width * sample, y, 0), 1);
    } else {
        TIFFSetField(tiff, TIFFTAG_TILEWIDTH, layout.tile);
        TIFFSetField(tiff, TIFFTAG_TILELENGTH, layout.tile);
        for (std::uint32_t top = 0; top < height; top += layout.tile) {
            for (std::uint32_t left = 0; left < width; left += layout.tile) {
                std::vector<std::byte> tile(std::size_t{layout.tile} * layout.tile * sample,
                                            std::byte{0xEE});  // padding beyond the image: must not be read
                const std::uint32_t columns = std::min(layout.tile, width - left);
                for (std::uint32_t y = 0; y < std::min(layout.tile, height - top); ++y) {
                    std::copy_n(
                        samples.begin() + static_cast<std::ptrdiff_t>((std::size_t{top + y} * width + left) * sample),
                        columns * sample,
                        tile.begin() + static_cast<std::ptrdiff_t>(std::size_t{y} * layout.tile * sample));
                }
                EXPECT_GE(TIFFWriteTile(tiff, tile.data(), left, top, 0, 0), 0);
            }
        }
    }
    TIFFClose(tiff);
    const std::string all = TempFolder::read(path);
    return {all.begin(), all.end()};
}

TEST(TiffCodec, reads_strips_and_tiles_of_every_byte_order_and_packing) {
    int read_too = 0;
    for (const int bits : {8, 16}) {
        const auto frame = pattern(53, 37, bits);
        for (const char* mode : {"wl", "wb"}) {
            for (const int packing : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_DEFLATE,
                                      COMPRESSION_PACKBITS}) {
                for (const int predictor : {PREDICTOR_NONE, PREDICTOR_HORIZONTAL}) {
                    if (predictor != PREDICTOR_NONE && (packing == COMPRESSION_NONE || packing == COMPRESSION_PACKBITS))
                        continue;
                    for (const std::uint32_t tile : {0U, 16U, 64U}) {
                        const Layout layout{.mode = mode, .packing = packing, .predictor = predictor, .tile = tile};
                        const Bytes file = tiff_of(frame, layout);
                        const auto read = decode_grey_tiff(file, "f.tiff");
                        ASSERT_TRUE(read) << text_of(layout) << ": " << read.error().message();
                        EXPECT_TRUE(same(*read, frame)) << bits << " bits, " << text_of(layout);
                        if (const cv::Mat image = decoded(file); !image.empty()) {
                            ++read_too;
                            EXPECT_TRUE(same(frame, image)) << bits << " bits, " << text_of(layout);
                        }
                    }
                }
            }
        }
    }
    EXPECT_GE(read_too, 90);  // of 96: OpenCV 4.6 does not read uncompressed 8-bit tiles of 16 px
}

TEST(TiffCodec, one_strip_of_all_rows_and_a_strip_a_row_are_read) {
    const auto frame = pattern(53, 37, 16);
    for (const std::uint32_t rows : {1U, 36U, 37U, std::numeric_limits<std::uint32_t>::max()}) {
        const auto read = decode_grey_tiff(tiff_of(frame, {.packing = COMPRESSION_LZW, .rows = rows}), "f.tiff");
        ASSERT_TRUE(read) << rows << ": " << read.error().message();
        EXPECT_TRUE(same(*read, frame)) << rows;
    }
}

TEST(TiffCodec, turns_a_frame_to_the_orientation_that_it_names_as_opencv_does) {
    for (const int bits : {8, 16}) {
        const auto frame = pattern(21, 34, bits);
        for (int orientation = ORIENTATION_TOPLEFT; orientation <= ORIENTATION_LEFTBOT; ++orientation) {
            // The expected frame is stored in strips: OpenCV 4.6 mixes up the columns of 8-bit tiles when it turns
            // them.
            const cv::Mat turned = decoded(tiff_of(frame, {.orientation = orientation}));
            for (const std::uint32_t tile : {0U, 16U, 64U}) {
                const Layout layout{.packing = COMPRESSION_LZW, .tile = tile, .orientation = orientation};
                const auto read = decode_grey_tiff(tiff_of(frame, layout), "f.tiff");
                ASSERT_TRUE(read) << text_of(layout) << ": " << read.error().message();
                EXPECT_TRUE(same(*read, turned)) << bits << " bits, " << text_of(layout);
            }
        }
    }
}

// Offset of a tag's entry in a little-endian file, bytes; 0 if the file has no such tag.
std::size_t entry_of(const Bytes& file, unsigned tag) {
    const auto number = [&](std::size_t at, unsigned size) {
        std::size_t value = 0;
        for (unsigned k = size; k > 0; --k) value = (value << 8U) | file[at + k - 1];
        return value;
    };
    const std::size_t first = number(4, 4) + 2;
    for (std::size_t k = 0; k < number(first - 2, 2); ++k) {
        if (number(first + 12 * k, 2) == tag) return first + 12 * k;
    }
    return 0;
}
void put_little_endian(Bytes& file, std::size_t at, std::uint32_t value) {
    for (unsigned k = 0; k < 4; ++k) file[at + k] = static_cast<std::uint8_t>(value >> (8 * k));
}

TEST(TiffCodec, a_part_whose_packed_bytes_are_cut_off_is_refused) {
    for (const int packing : {COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS}) {
        for (const std::uint32_t tile : {0U, 64U}) {
            const Layout layout{.packing = packing, .rows = 64, .tile = tile};  // one strip, one tile
            Bytes file = tiff_of(pattern(53, 37, 16), layout);
            const std::size_t counts = entry_of(file, tile == 0 ? TIFFTAG_STRIPBYTECOUNTS : TIFFTAG_TILEBYTECOUNTS);
            ASSERT_NE(counts, 0U);
            const std::uint32_t count = file[counts + 8] | static_cast<std::uint32_t>(file[counts + 9]) << 8U;
            for (const std::uint32_t less : {count / 2, count - count / 8, 1U}) {
                put_little_endian(file, counts + 8, less);
                const auto read = decode_grey_tiff(file, "cut.tiff");
                ASSERT_FALSE(read) << text_of(layout) << " cut to " << less << " of " << count;
                EXPECT_EQ(read.error().code, ErrorCode::unreadable);
                EXPECT_THAT(read.error().what, testing::AllOf(HasSubstr("cut.tiff"), HasSubstr("damaged (")));
                EXPECT_FALSE(read.error().cure.empty());
            }
        }
    }
}

TEST(TiffCodec, whatever_is_wrong_is_in_the_error_and_nothing_is_printed) {
    testing::internal::CaptureStderr();
    const Bytes good = tiff_of(pattern(53, 37, 16), {.packing = COMPRESSION_LZW});
    std::mt19937 random(7);
    int refused = 0;
    for (int k = 0; k < 2000; ++k) {
        Bytes file = good;
        for (unsigned changes = 1 + random() % 4; changes > 0; --changes)
            file[random() % file.size()] = static_cast<std::uint8_t>(random());
        if (k % 3 == 0) file.resize(random() % file.size());
        const auto read = decode_grey_tiff(file, "f.tiff");
        if (read) continue;
        ++refused;
        EXPECT_THAT(read.error().what, HasSubstr("f.tiff"));
    }
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    EXPECT_GT(refused, 500);
}

TEST(TiffCodec, takes_no_memory_that_the_file_cannot_fill) {
    for (const std::uint32_t tile : {0U, 16U}) {
        const Bytes good = tiff_of(pattern(53, 37, 16), {.packing = COMPRESSION_LZW, .rows = 64, .tile = tile});
        const auto with = [&](std::initializer_list<std::uint32_t> tags, std::uint32_t value) {
            Bytes file = good;
            for (const std::uint32_t tag : tags) {
                const std::size_t at = entry_of(file, tag);
                file[at + 2] = TIFF_LONG;
                put_little_endian(file, at + 8, value);
            }
            return decode_grey_tiff(file, "huge.tiff");
        };
        const auto huge = with({TIFFTAG_IMAGEWIDTH, TIFFTAG_IMAGELENGTH}, 60'000);
        ASSERT_FALSE(huge);
        EXPECT_EQ(huge.error().code, ErrorCode::unreadable);
        const auto absurd = with({TIFFTAG_IMAGEWIDTH, TIFFTAG_IMAGELENGTH}, 2'000'000'000);
        ASSERT_FALSE(absurd);
        if (tile == 0) continue;
        EXPECT_FALSE(with({TIFFTAG_TILEWIDTH, TIFFTAG_TILELENGTH}, 32'768));  // 2 GB a tile
        EXPECT_FALSE(with({TIFFTAG_TILEWIDTH, TIFFTAG_TILELENGTH}, 0xFFFF'FFF0U));
    }
    // A frame with the highest compression ratio is still read.
    const Frame dark(3000, 2000, 16);
    for (const int packing : {COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_PACKBITS}) {
        for (const std::uint32_t tile : {0U, 1024U}) {
            const auto read =
                decode_grey_tiff(tiff_of(dark, {.packing = packing, .rows = 2000, .tile = tile}), "dark.tiff");
            ASSERT_TRUE(read) << packing << ": " << read.error().message();
            EXPECT_TRUE(same(*read, dark));
        }
    }
}

TEST(TiffCodec, tags_that_name_the_same_bytes_over_and_over_do_not_fill_memory) {
    // 150 unknown tags, each of which refers to the whole file of 4 MB: 600 MB if all were kept in memory.
    constexpr std::uint32_t kTags = 150, kSize = 4 << 20, kDirectory = 8;
    Bytes file(kSize);
    const auto put16 = [&](std::size_t at, std::uint32_t value) {
        file[at] = static_cast<std::uint8_t>(value), file[at + 1] = static_cast<std::uint8_t>(value >> 8U);
    };
    std::copy_n("II*", 3, file.begin());
    put_little_endian(file, 4, kDirectory);
    put16(kDirectory, kTags);
    std::size_t at = kDirectory + 2;
    const auto tag = [&](std::uint32_t which, std::uint32_t type, std::uint32_t count, std::uint32_t value) {
        put16(at, which), put16(at + 2, type), put_little_endian(file, at + 4, count),
            put_little_endian(file, at + 8, value);
        at += 12;
    };
    tag(TIFFTAG_IMAGEWIDTH, TIFF_LONG, 1, 16);
    tag(TIFFTAG_IMAGELENGTH, TIFF_LONG, 1, 16);
    tag(TIFFTAG_BITSPERSAMPLE, TIFF_SHORT, 1, 8);
    tag(TIFFTAG_PHOTOMETRIC, TIFF_SHORT, 1, PHOTOMETRIC_MINISBLACK);
    tag(TIFFTAG_STRIPOFFSETS, TIFF_LONG, 1, 1 << 20);
    tag(TIFFTAG_STRIPBYTECOUNTS, TIFF_LONG, 1, 256);
    for (std::uint32_t k = 6; k < kTags; ++k) tag(40'000 + k, TIFF_BYTE, kSize, 0);
    const auto peak_kb = [] {
        rusage used{};
        getrusage(RUSAGE_SELF, &used);
        return used.ru_maxrss;
    };
    const long before = peak_kb();
    const auto read = decode_grey_tiff(file, "tags.tiff");
    ASSERT_FALSE(read);
    EXPECT_THAT(read.error().what, HasSubstr("overlap"));
    EXPECT_LT(peak_kb() - before, 200 * 1024);
}

TEST(TiffCodec, what_it_does_not_read_is_named) {
    const auto expect_unsupported = [](const Bytes& file, const char* says) {
        const auto read = decode_grey_tiff(file, "f.tiff");
        ASSERT_FALSE(read) << says;
        EXPECT_EQ(read.error().code, ErrorCode::unsupported) << read.error().message();
        EXPECT_THAT(read.error().what, HasSubstr(says));
    };
    expect_unsupported(tiff_of(pattern(53, 37, 8), {.packing = COMPRESSION_JPEG, .rows = 64}), "method 7");
    expect_unsupported(*encode_float_tiff(2, 1, std::vector<float>{1, 2}), "32 bits");
    Bytes colour;
    ASSERT_TRUE(cv::imencode(".tiff", cv::Mat(4, 4, CV_8UC3, cv::Scalar(1, 2, 3)), colour));
    expect_unsupported(colour, "3 samples");
    Bytes inverted = tiff_of(pattern(53, 37, 8), {});
    inverted[entry_of(inverted, TIFFTAG_PHOTOMETRIC) + 8] = PHOTOMETRIC_MINISWHITE;
    expect_unsupported(inverted, "inverted grey");
    EXPECT_FALSE(decode_grey_tiff({}, "empty.tiff"));
    EXPECT_FALSE(decode_grey_tiff(Bytes{'n', 'o', 'n', 'e'}, "none.tiff"));
}

TEST(TiffCodec, a_map_of_floats_is_read_back_bit_for_bit) {
    for (const auto& [width, height] : {std::pair{1, 1}, {60, 48}, {1, 3000}, {3000, 1}}) {
        std::vector<float> values;
        for (int k = 0; k < width * height; ++k) values.push_back(static_cast<float>(k) * 1.37e-3F - 2);
        values.back() = std::numeric_limits<float>::denorm_min();
        if (values.size() > 3) values[1] = std::numeric_limits<float>::infinity();
        const auto file = encode_float_tiff(width, height, values);
        ASSERT_TRUE(file) << file.error().message();
        const cv::Mat image = decoded(*file);
        ASSERT_EQ(image.type(), CV_32FC1);
        ASSERT_EQ(image.size(), cv::Size(width, height));
        EXPECT_EQ(std::memcmp(image.data, values.data(), values.size() * sizeof(float)), 0) << width << "x" << height;
    }
}

TEST(TiffCodec, a_map_that_is_not_of_its_size_is_refused) {
    const std::vector<float> values(6);
    for (const auto& [width, height] : {std::pair{3, 3}, {0, 6}, {-2, -3}}) {
        const auto file = encode_float_tiff(width, height, values);
        ASSERT_FALSE(file);
        EXPECT_EQ(file.error().code, ErrorCode::invalid_argument);
    }
}

// -- the file

}  // namespace
}  // namespace hord::common
