#include "drivers/files/frame_file.h"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/stat.h>
#include <zlib.h>

#include "tests/support/temp_folder.h"

namespace hord::drivers {
namespace {

using testing::HasSubstr;
using testing_support::TempFolder;
namespace fs = std::filesystem;

Frame ramp(int width, int height, int bits) {
    Frame frame(width, height, bits);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x)
            frame.set(x, y, static_cast<std::uint32_t>(x * 7 + y * 131) & frame.view().full_scale());
    }
    return frame;
}

void expect_equal(const Frame& read, const Frame& written) {
    EXPECT_EQ(read.width_px(), written.width_px());
    EXPECT_EQ(read.height_px(), written.height_px());
    EXPECT_TRUE(std::ranges::equal(read.bytes(), written.bytes()));
}

void expect_refused(const Result<Frame>& result, const fs::path& file, ErrorCode code, const char* says) {
    ASSERT_FALSE(result) << "accepted " << file;
    EXPECT_EQ(result.error().code, code) << result.error().message();
    EXPECT_THAT(result.error().what, HasSubstr(file.string()));
    EXPECT_THAT(result.error().what, HasSubstr(says));
    EXPECT_FALSE(result.error().cure.empty());
}

class FrameFile : public testing::Test {
  protected:
    fs::path file(const char* name) { return folder_.path() / name; }
    fs::path cv_file(const char* name, const cv::Mat& image) {
        const auto path = file(name);
        EXPECT_TRUE(cv::imwrite(path.string(), image));
        return path;
    }
    cv::Mat as_mat(Frame& frame) {
        return {frame.height_px(), frame.width_px(), frame.bits() > 8 ? CV_16UC1 : CV_8UC1, frame.bytes().data()};
    }
    TempFolder folder_;
};

TEST_F(FrameFile, png_keeps_every_sample_at_8_12_and_16_bits) {
    for (const int bits : {8, 12, 16}) {
        const auto frame = ramp(27, 18, bits);
        ASSERT_TRUE(write_frame(file("f.png"), frame.view()));
        const auto read = read_frame(file("f.png"), {.bits = bits});
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(read->bits(), bits);
        expect_equal(*read, frame);
    }
}

TEST_F(FrameFile, a_16_bit_file_is_16_bits_unless_told_otherwise) {
    ASSERT_TRUE(write_frame(file("f.png"), ramp(9, 9, 12).view()));
    EXPECT_EQ(read_frame(file("f.png"))->bits(), 16);
}

TEST_F(FrameFile, writes_rows_that_are_padded) {
    const auto wide = ramp(32, 4, 8);
    auto view = wide.view();
    view.width_px = 27;
    ASSERT_TRUE(write_frame(file("f.png"), view));
    const auto read = read_frame(file("f.png"));
    ASSERT_TRUE(read);
    EXPECT_EQ(read->width_px(), 27);
    EXPECT_EQ(read->view().sample(26, 3), wide.view().sample(26, 3));
}

TEST_F(FrameFile, tiff_8_and_16_bits_is_good_input) {
    for (const int bits : {8, 16}) {
        auto frame = ramp(27, 18, bits);
        const auto read = read_frame(cv_file("f.tiff", as_mat(frame)));
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(read->bits(), bits);
        expect_equal(*read, frame);
    }
}

TEST_F(FrameFile, pgm_says_its_own_depth_and_is_big_endian) {
    const auto eight = read_frame(folder_.write("8.pgm", std::string("P5\n# a comment\n2 1\n255\n\x01\xFE", 25)));
    ASSERT_TRUE(eight) << eight.error().message();
    EXPECT_EQ(eight->bits(), 8);
    EXPECT_EQ(eight->view().sample(1, 0), 0xFEU);
    const auto twelve = read_frame(folder_.write("12.pgm", std::string("P5 2 1 4095\n\x0A\xBC\x00\x01", 16)));
    ASSERT_TRUE(twelve) << twelve.error().message();
    EXPECT_EQ(twelve->bits(), 12);
    EXPECT_EQ(twelve->view().sample(0, 0), 0xABCU);
    EXPECT_EQ(twelve->view().sample(1, 0), 1U);
}

// Every truncation of a good file is refused. (OpenCV decodes many of them.)
TEST_F(FrameFile, no_truncated_file_is_accepted_wherever_it_is_cut) {
    auto frame = ramp(45, 36, 16);
    ASSERT_TRUE(write_frame(file("good.png"), frame.view()));
    cv_file("good.tiff", as_mat(frame));
    folder_.write("good.pgm", "P5 45 36 65535\n" + std::string(45 * 36 * 2, 'x'));
    for (const char* name : {"good.png", "good.tiff", "good.pgm"}) {
        const std::string whole = TempFolder::read(file(name));
        ASSERT_TRUE(read_frame(file(name))) << name;
        for (std::size_t size = 0; size < whole.size(); size += std::max<std::size_t>(1, whole.size() / 61)) {
            const auto cut = folder_.write("cut", std::string_view(whole).substr(0, size));
            const auto result = read_frame(cut);
            ASSERT_FALSE(result) << name << " cut to " << size << " of " << whole.size();
            EXPECT_THAT(result.error().what, HasSubstr(cut.string()));
        }
        const auto last = folder_.write("cut", std::string_view(whole).substr(0, whole.size() - 1));
        expect_refused(read_frame(last), last, ErrorCode::unreadable, "truncated");
    }
}

// A quarter turn exchanges width and height, also in the expected format.
TEST_F(FrameFile, a_tiff_that_names_an_orientation_is_turned_and_has_the_turned_size) {
    auto frame = ramp(27, 18, 16);
    std::string bytes = TempFolder::read(cv_file("f.tiff", as_mat(frame)));
    const auto number = [&](std::size_t at, std::size_t size) {
        std::size_t value = 0;
        for (std::size_t k = size; k > 0; --k) value = (value << 8U) | static_cast<unsigned char>(bytes[at + k - 1]);
        return value;
    };
    ASSERT_EQ(bytes.substr(0, 2), "II");
    const std::size_t first = number(4, 4) + 2;
    for (std::size_t k = 0; k < number(first - 2, 2); ++k) {
        const std::size_t entry = first + 12 * k;
        if (number(entry, 2) != 277)
            continue;  // SamplesPerPixel defaults to 1: its entry is replaced by the orientation, which sorts before it
        bytes.replace(entry, 12, std::string("\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00", 12));
    }
    const auto turned = folder_.write("turned.tiff", bytes);
    const auto read = read_frame(turned, {.width_px = 18, .height_px = 27});
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->view().sample(17, 0), frame.view().sample(0, 0));
    EXPECT_EQ(read->view().sample(17, 26), frame.view().sample(26, 0));
    EXPECT_EQ(read->view().sample(0, 0), frame.view().sample(0, 17));
    EXPECT_FALSE(read_frame(turned, {.width_px = 27, .height_px = 18}));
}

TEST_F(FrameFile, a_damaged_png_is_refused) {
    ASSERT_TRUE(write_frame(file("good.png"), ramp(45, 36, 8).view()));
    std::string bytes = TempFolder::read(file("good.png"));
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x10);
    const auto bad = folder_.write("bad.png", bytes);
    expect_refused(read_frame(bad), bad, ErrorCode::unreadable, "damaged");
}

TEST_F(FrameFile, colour_palette_and_float_images_are_refused) {
    const auto colour = cv_file("c.png", cv::Mat(9, 9, CV_8UC3, cv::Scalar(1, 2, 3)));
    expect_refused(read_frame(colour), colour, ErrorCode::unsupported, "colour");
    const auto alpha = cv_file("a.png", cv::Mat(9, 9, CV_8UC4, cv::Scalar(1, 2, 3, 4)));
    expect_refused(read_frame(alpha), alpha, ErrorCode::unsupported, "alpha");
    const auto tiff = cv_file("c.tiff", cv::Mat(9, 9, CV_16UC3, cv::Scalar(1, 2, 3)));
    expect_refused(read_frame(tiff), tiff, ErrorCode::unsupported, "3 samples");
    const auto floats = cv_file("f.tiff", cv::Mat(9, 9, CV_32FC1, cv::Scalar(1)));
    expect_refused(read_frame(floats), floats, ErrorCode::unsupported, "not a grey frame");
    const auto ppm = cv_file("c.ppm", cv::Mat(9, 9, CV_8UC3, cv::Scalar(1, 2, 3)));
    expect_refused(read_frame(ppm), ppm, ErrorCode::unsupported, "colour");
    const auto jpeg = cv_file("g.jpg", cv::Mat(9, 9, CV_8UC1, cv::Scalar(1)));
    expect_refused(read_frame(jpeg), jpeg, ErrorCode::unsupported, "JPEG");
}

TEST_F(FrameFile, what_is_no_image_is_refused) {
    const auto text = folder_.write("t.png", "this is not an image\n");
    expect_refused(read_frame(text), text, ErrorCode::unreadable, "not a PNG, TIFF or binary PGM");
    const auto empty = folder_.write("e.png", "");
    expect_refused(read_frame(empty), empty, ErrorCode::unreadable, "empty");
    expect_refused(read_frame(folder_.path()), folder_.path(), ErrorCode::unreadable, "is a folder");
    EXPECT_EQ(read_frame("/tmp/").error().cure, "name the frames in it, such as /tmp/*.png");
    expect_refused(read_frame(file("none.png")), file("none.png"), ErrorCode::not_found, "does not exist");
    const auto pipe = file("pipe");
    ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    expect_refused(read_frame(pipe), pipe, ErrorCode::unreadable,
                   "is a pipe, not a regular file");  // without waiting for a writer
}

// A file manager of another system leaves ._a.png beside a.png: no image, which kept the station from starting.
TEST_F(FrameFile, that_is_hidden_in_a_folder_is_no_frame) {
    ASSERT_TRUE(write_frame(file("a.png"), Frame(4, 4, 8).view()));
    folder_.write("._a.png", "x");
    folder_.write(".png", "x");
    EXPECT_EQ(list_frames({folder_.path()}).value(), std::vector<std::filesystem::path>{file("a.png")});
    EXPECT_EQ(list_frames({file("._a.png")}).value(), std::vector<std::filesystem::path>{file("._a.png")})
        << "as it is named";
}

TEST_F(FrameFile, an_absurd_size_is_refused_before_memory_is_taken) {
    const auto pgm = folder_.write("huge.pgm", "P5 1000000 1000000 255\nx");
    expect_refused(read_frame(pgm), pgm, ErrorCode::unsupported, "1000000x1000000");
    // A PNG of black rows is a thousandth of its samples: its declared size decides, before anything is unpacked.
    ASSERT_TRUE(write_frame(file("black.png"), Frame(2000, 2000, 8).view()));
    std::string png = folder_.read(file("black.png"));
    const auto declare = [&](std::uint32_t width, std::uint32_t height) {  // in IHDR, with its checksum
        for (unsigned k = 0; k < 4; ++k) {
            png[16 + k] = static_cast<char>(width >> (24 - 8 * k));
            png[20 + k] = static_cast<char>(height >> (24 - 8 * k));
        }
        const auto sum = crc32(0, reinterpret_cast<const Bytef*>(png.data()) + 12, 17);
        for (unsigned k = 0; k < 4; ++k) png[29 + k] = static_cast<char>(sum >> (24 - 8 * k));
        return folder_.write("declared.png", png);
    };
    const auto huge = declare(30'000, 30'000);
    expect_refused(read_frame(huge), huge, ErrorCode::unsupported, "30000x30000");
    const auto other = declare(2000, 1999);
    expect_refused(read_frame(other, {.width_px = 2000, .height_px = 2000}), other, ErrorCode::invalid_argument,
                   "2000x1999 pixels, expected 2000x2000");
}

TEST_F(FrameFile, what_was_not_expected_is_refused_naming_both_sizes) {
    ASSERT_TRUE(write_frame(file("f.png"), ramp(27, 18, 8).view()));
    expect_refused(read_frame(file("f.png"), {.width_px = 27, .height_px = 27}), file("f.png"),
                   ErrorCode::invalid_argument, "27x18 pixels, expected 27x27");
    expect_refused(read_frame(file("f.png"), {.bits = 12}), file("f.png"), ErrorCode::invalid_argument,
                   "8-bit samples, expected 12");
    ASSERT_TRUE(write_frame(file("g.png"), ramp(27, 18, 16).view()));
    expect_refused(read_frame(file("g.png"), {.bits = 8}), file("g.png"), ErrorCode::invalid_argument,
                   "16-bit samples, expected 8");
    expect_refused(read_frame(file("g.png"), {.bits = 10}), file("g.png"), ErrorCode::invalid_argument,
                   "more than 10 bits");
}

TEST_F(FrameFile, writing_into_a_missing_folder_says_so_and_leaves_nothing) {
    const auto frame = ramp(9, 9, 8);
    const auto done = write_frame(file("no") / "f.png", frame.view());
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::not_found);
    EXPECT_THAT(done.error().what, HasSubstr((folder_.path() / "no").string()));
    ASSERT_TRUE(write_frame(file("f.png"), frame.view()));
    EXPECT_FALSE(fs::exists(file("f.png.part")));
}

}  // namespace
}  // namespace hord::drivers
