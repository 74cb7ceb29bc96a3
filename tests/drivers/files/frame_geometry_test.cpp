// The geometry note of a frame: written, read back, compared with the frame; damaged ones are refused by name.
#include "drivers/files/frame_geometry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "drivers/files/frame_file.h"
#include "tests/support/temp_folder.h"

namespace hord::drivers {
namespace {

using testing::HasSubstr;

constexpr FrameGeometry kMacro12{FrameKind::macro_pixels, {4, 3, 5, 7}, 12};
constexpr FrameGeometry kRaw12{FrameKind::raw, {}, 12};

Frame ramp(int width, int height, int bits) {
    Frame frame(width, height, bits);
    for (int k = 0; k < width * height; ++k) frame.set(k % width, k / width, static_cast<std::uint32_t>(k) % 250);
    return frame;
}

class Geometry : public testing::Test {
  protected:
    std::filesystem::path png(const std::optional<FrameGeometry>& geometry, int bits = 12) const {
        const auto file = folder_.path() / "f.png";
        EXPECT_TRUE(write_frame(file, ramp(20, 21, bits).view(), geometry));
        return file;
    }
    // A PGM says nothing of its geometry by itself.
    std::filesystem::path pgm() const { return folder_.write("g.pgm", "P5 20 21 255\n" + std::string(420, '\x07')); }

    testing_support::TempFolder folder_;
};

TEST_F(Geometry, of_a_png_is_read_back_with_the_bits) {
    for (const FrameGeometry& written : {kMacro12, kRaw12}) {
        const auto read = read_noted_frame(png(written));
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(read->geometry, written);
        EXPECT_EQ(read->frame.bits(), 12);
    }
    const auto plain = read_noted_frame(png(std::nullopt));
    ASSERT_TRUE(plain);
    EXPECT_FALSE(plain->geometry);
    EXPECT_EQ(plain->frame.bits(), 16);  // as the file has
    EXPECT_EQ(read_frame(png(kMacro12))->bits(), 16);
}

TEST_F(Geometry, of_another_format_is_read_from_the_sidecar) {
    const auto file = pgm();
    EXPECT_EQ(sidecar_of(file), folder_.path() / "g.frame.json");
    EXPECT_FALSE(read_noted_frame(file)->geometry);
    const FrameGeometry written{FrameKind::macro_pixels, {4, 3, 5, 7}, 8};
    folder_.write("g.frame.json", to_json(written));
    const auto read = read_noted_frame(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ(read->geometry, written);
    // 12 bits in a 16-bit file: only the sidecar knows.
    ASSERT_TRUE(write_frame(folder_.path() / "h.png", ramp(20, 21, 12).view()));
    folder_.write("h.frame.json", to_json(kRaw12));
    EXPECT_EQ(read_noted_frame(folder_.path() / "h.png")->frame.bits(), 12);
}

TEST_F(Geometry, of_a_kept_frame_is_in_its_metadata) {
    const auto old = geometry_from_json(R"({"hord":1,"part":7,"grid":{"m":4,"n":3,"i":5,"j":7},"bits":12})", "f");
    ASSERT_TRUE(old) << old.error().message();
    EXPECT_EQ(*old, kMacro12);
}

void expect_refused(const Result<NotedFrame>& read, ErrorCode code, const std::vector<std::string>& words) {
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, code) << read.error().what;
    for (const std::string& word : words) EXPECT_THAT(read.error().what, HasSubstr(word));
    EXPECT_FALSE(read.error().cure.empty());
}

TEST_F(Geometry, that_is_damaged_is_refused_and_names_the_file) {
    const auto file = pgm();
    const std::string grid = R"("grid":{"m":4,"n":3,"i":5,"j":7})";
    for (const std::string& text :
         {std::string("not JSON"), std::string("[1]"), std::string("{}"), std::string(R"({"schema":1})"),
          R"({"schema":1,"kind":"macro-pixels","bits":8})" + std::string(),
          R"({"schema":1,"kind":"macro","bits":8,)" + grid + "}", R"({"schema":1,"kind":"raw","bits":8,)" + grid + "}",
          R"({"schema":1,"kind":"macro-pixels","bits":7,)" + grid + "}",
          R"({"schema":1,"kind":"macro-pixels","bits":8.5,)" + grid + "}",
          std::string(R"({"schema":1,"kind":"macro-pixels","bits":8,"grid":{"m":4,"n":3,"i":5}})"),
          std::string(R"({"schema":1,"kind":"macro-pixels","bits":8,"grid":{"m":4,"n":3,"i":5,"j":4294967303}})"),
          std::string(R"({"schema":1,"kind":"macro-pixels","bits":8,"grid":{"m":4,"n":3,"i":5,"j":99}})")}) {
        folder_.write("g.frame.json", text);
        SCOPED_TRACE(text);
        expect_refused(read_noted_frame(file), ErrorCode::unreadable, {(folder_.path() / "g.frame.json").string()});
    }
    folder_.write("g.frame.json", R"({"schema":2,"kind":"raw","bits":8})");
    expect_refused(read_noted_frame(file), ErrorCode::unsupported, {"g.frame.json", "schema 2"});
}

TEST_F(Geometry, that_contradicts_the_frame_or_the_other_note_is_refused) {
    const auto size = png(FrameGeometry{FrameKind::macro_pixels, {4, 3, 5, 9}, 12});
    expect_refused(read_noted_frame(size), ErrorCode::unreadable, {size.string(), "20x27", "20x21"});
    const auto depth = png(kMacro12, 8);
    expect_refused(read_noted_frame(depth), ErrorCode::unreadable, {depth.string(), "8", "12"});
    const auto both = png(kMacro12);
    folder_.write("f.frame.json", to_json(kMacro12));
    EXPECT_TRUE(read_noted_frame(both));
    folder_.write("f.frame.json", to_json(kRaw12));
    expect_refused(read_noted_frame(both), ErrorCode::unreadable,
                   {both.string(), "f.frame.json", "macro-pixels of 5x7 bins", "a raw frame of 12 bits"});
}

}  // namespace
}  // namespace hord::drivers
