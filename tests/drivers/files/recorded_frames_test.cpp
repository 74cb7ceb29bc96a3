#include "drivers/files/recorded_frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/virtual_time/virtual_time.h"
#include "tests/support/temp_folder.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

struct Ear final : hal::Sensor::Listener {
    void on_frame(hal::FrameLease frame) override { frames.push_back(std::move(frame)); }
    void on_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<hal::FrameLease> frames;
    std::vector<Error> losses;
};

class Recorded : public testing::Test {
  protected:
    void write(const char* name, std::uint32_t value, int width = 9, int bits = 8) {
        Frame frame(width, 9, bits);
        frame.set(0, 0, value);
        ASSERT_TRUE(write_frame(folder_.path() / name, frame.view()));
    }
    // Plays `count` triggers and returns the first sample of each frame.
    std::vector<std::uint32_t> play(RecordedFrames& sensor, Ear& ear, int count) {
        std::vector<std::uint32_t> out;
        for (int k = 0; k < count; ++k) {
            (void)sensor.trigger({1, loop_.now(), 100us});
            loop_.run_for(5ms);
            if (ear.frames.empty()) break;
            out.push_back(ear.frames[0].view().sample(0, 0));
            ear.frames.clear();
        }
        return out;
    }
    lab::VirtualTime loop_;
    testing_support::TempFolder folder_;
};

TEST_F(Recorded, plays_a_folder_in_the_order_of_names_and_leaves_other_files_alone) {
    write("b.png", 2);
    write("a.png", 1);
    write("c.PNG", 3);
    folder_.write("README.md", "about these frames");
    auto sensor = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_TRUE(sensor) << sensor.error().message();
    Ear ear;
    ASSERT_TRUE((*sensor)->start(ear));
    EXPECT_THAT(play(**sensor, ear, 3), ElementsAre(1U, 2U, 3U));
}

TEST_F(Recorded, plays_a_list_in_its_own_order) {
    write("a.png", 1);
    write("b.png", 2);
    auto sensor = RecordedFrames::open(loop_, {folder_.path() / "b.png", folder_.path() / "a.png"});
    ASSERT_TRUE(sensor);
    Ear ear;
    ASSERT_TRUE((*sensor)->start(ear));
    EXPECT_THAT(play(**sensor, ear, 2), ElementsAre(2U, 1U));
}

TEST_F(Recorded, after_the_last_frame_the_device_is_lost_once_and_a_restart_plays_again) {
    write("a.png", 1);
    auto sensor = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_TRUE(sensor);
    Ear ear;
    ASSERT_TRUE((*sensor)->start(ear));
    EXPECT_THAT(play(**sensor, ear, 5), ElementsAre(1U));
    const auto done = (*sensor)->trigger({1, loop_.now(), 100us});
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, ErrorCode::disconnected);
    loop_.run_for(5ms);
    ASSERT_EQ(ear.losses.size(), 1U);
    EXPECT_THAT(ear.losses[0].what, HasSubstr("played"));
    (*sensor)->stop();
    ASSERT_TRUE((*sensor)->start(ear));
    EXPECT_THAT(play(**sensor, ear, 1), ElementsAre(1U));
}

TEST_F(Recorded, every_bad_file_is_named_before_anything_runs) {
    write("a.png", 1);
    write("b.png", 2, 18);
    write("c.png", 3, 9, 16);
    write("c2.png", 3, 9, 16);
    folder_.write("d.png", "not an image");
    const auto sensor = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_FALSE(sensor);
    const auto file = [&](const char* name) { return (folder_.path() / name).string(); };
    EXPECT_THAT(sensor.error().message(),
                StartsWith(file("b.png") + " is 18x9 pixels, and the frames before it 9x9: play frames of one size\n" +
                           file("c.png") + " has 16-bit samples, and the frames before it 8\n" + file("c2.png") +
                           " has 16-bit samples, and the frames before it 8: play frames of one depth\n" +
                           file("d.png") + " is not a PNG"));
}

TEST_F(Recorded, frames_without_a_note_have_the_bits_that_are_named) {
    write("a.png", 4000, 9, 12);
    const auto as_the_file = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_TRUE(as_the_file);
    EXPECT_EQ((*as_the_file)->format().bits, 16);
    const auto named = RecordedFrames::open(loop_, {folder_.path()}, {}, 12);
    ASSERT_TRUE(named) << named.error().message();
    EXPECT_EQ((*named)->format().bits, 12);
    for (const int wrong : {8, 10}) EXPECT_FALSE(RecordedFrames::open(loop_, {folder_.path()}, {}, wrong)) << wrong;
    const FrameGeometry noted{FrameKind::macro_pixels, {5, 5, 9, 9}, 12};
    ASSERT_TRUE(write_frame(folder_.path() / "a.png", Frame(45, 45, 12).view(), noted));
    const auto by_note = RecordedFrames::open(loop_, {folder_.path()}, {}, 10);
    ASSERT_TRUE(by_note) << by_note.error().message();
    EXPECT_EQ((*by_note)->format().bits, 12);
}

TEST_F(Recorded, a_missing_file_an_empty_folder_and_no_name_at_all_are_refused) {
    const auto missing = RecordedFrames::open(loop_, {folder_.path() / "none.png"});
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().code, ErrorCode::not_found);
    EXPECT_THAT(missing.error().what, HasSubstr("none.png"));
    const auto empty = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_FALSE(empty);
    EXPECT_EQ(empty.error().code, ErrorCode::not_found);
    EXPECT_THAT(empty.error().what, HasSubstr(folder_.path().string()));
    EXPECT_FALSE(RecordedFrames::open(loop_, {}));
}

TEST_F(Recorded, frames_of_two_geometries_are_refused_and_one_is_told) {
    const auto noted = [&](const char* name, int i, int bits) {
        const FrameGeometry geometry{FrameKind::macro_pixels, {45 / i, 45 / i, i, i}, bits};
        ASSERT_TRUE(write_frame(folder_.path() / name, Frame(45, 45, bits).view(), geometry));
    };
    noted("b.png", 9, 12);
    ASSERT_TRUE(write_frame(folder_.path() / "c.png", Frame(45, 45, 12).view()));  // says nothing
    const auto one = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_TRUE(one) << one.error().message();
    EXPECT_EQ((*one)->format().bits, 12);
    ASSERT_TRUE((*one)->noted());
    EXPECT_EQ((*one)->noted()->geometry.grid.i, 9);
    noted("d.png", 5, 12);
    const auto two = RecordedFrames::open(loop_, {folder_.path()});
    ASSERT_FALSE(two);
    EXPECT_THAT(two.error().what, AllOf(HasSubstr("d.png"), HasSubstr("5x5"), HasSubstr("b.png"), HasSubstr("9x9")));
}

}  // namespace
}  // namespace hord::drivers
