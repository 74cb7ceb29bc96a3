// A camera that another process holds: normal operation, crashes and hangs of that process. fake_camera_program.cpp
// replaces hord-camera.
#include "drivers/camera_process/camera_process.h"

#include <array>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <thread>

#include <dirent.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_port_sensor.h"
#include "drivers/camera_process/camera_wire.h"
#include "drivers/event_loop/event_loop_sd.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;

const std::filesystem::path kProgram = std::filesystem::path(HORD_BIN_DIR) / "hord_fake_camera";
constexpr auto kPatience = 120s;  // for another process, on a busy machine

class Heard final : public CameraPort::Listener {
  public:
    void on_camera_frame(const CameraFrame& frame) noexcept override {
        const std::scoped_lock lock(mutex_);
        frames_.push_back(frame);
        changed_.notify_all();
    }
    void on_camera_gone(std::string_view why, std::string_view cure) noexcept override {
        const std::scoped_lock lock(mutex_);
        ++gone_;
        why_ = why;
        cure_ = cure;
        changed_.notify_all();
    }
    bool wait_for_frames(std::size_t count) {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, kPatience, [&] { return frames_.size() >= count; });
    }
    bool wait_until_gone() {
        std::unique_lock lock(mutex_);
        return changed_.wait_for(lock, kPatience, [&] { return gone_ > 0; });
    }
    CameraFrame frame(std::size_t k) {
        const std::scoped_lock lock(mutex_);
        return frames_[k];
    }
    std::string why() {
        const std::scoped_lock lock(mutex_);
        return why_;
    }
    std::string cure() {
        const std::scoped_lock lock(mutex_);
        return cure_;
    }
    int gone() {
        const std::scoped_lock lock(mutex_);
        return gone_;
    }

  private:
    std::mutex mutex_;
    std::condition_variable changed_;
    std::vector<CameraFrame> frames_;
    int gone_ = 0;
    std::string why_, cure_;
};

std::unique_ptr<CameraPort> camera_called(const std::string& name, hal::Duration patience = kPatience) {
    return open_camera_process(name, kProgram, patience);
}

// Child processes that were not reaped yet.
std::vector<pid_t> children_pids() {
    std::ifstream in("/proc/self/task/" + std::to_string(gettid()) + "/children");
    std::vector<pid_t> pids;
    for (pid_t pid = 0; in >> pid;) pids.push_back(pid);
    return pids;
}
std::size_t children() { return children_pids().size(); }

TEST(CameraProcess, shares_the_cameras_memory_and_fills_buffers_again) {
    const auto port = camera_called("works");
    const auto format = port->look();
    ASSERT_TRUE(format) << format.error().message();
    EXPECT_EQ(format->width_px, 8);
    EXPECT_EQ(format->grey.name, "R8");
    Heard heard;
    const auto memory = port->start(heard);
    ASSERT_TRUE(memory) << memory.error().message();
    ASSERT_EQ((*memory)->size(), 3U);
    for (std::size_t k = 0; k < 7; ++k) {
        ASSERT_TRUE(heard.wait_for_frames(k + 1));
        const CameraFrame frame = heard.frame(k);
        EXPECT_EQ(frame.sequence, k + 1);
        EXPECT_EQ((**memory)[frame.buffer].size(), 16U);
        EXPECT_EQ(std::to_integer<std::size_t>((**memory)[frame.buffer][0]), k + 1);
        ASSERT_TRUE(port->queue(frame.buffer));
    }
    port->stop();
    EXPECT_EQ(heard.gone(), 0);
    EXPECT_EQ(children(), 0U);
    EXPECT_NE((**memory)[0][0], std::byte{0}) << "memory that is held stays readable";
}

TEST(CameraProcess, lists_the_cameras_that_it_could_hold) {
    const auto cameras = list_cameras("works", kProgram, kPatience);
    ASSERT_TRUE(cameras) << cameras.error().message();
    ASSERT_EQ(cameras->size(), 2U);
    EXPECT_EQ((*cameras)[0].name, "mono");
    EXPECT_EQ((*cameras)[0].text, "imx  296") << "no control characters";
    EXPECT_EQ((*cameras)[0].formats[1], (hal::ListedFormat{"R10_CSI2P", 10, 1456, 1088, {"640x480", "1456x1088"}}));
    const auto refused = list_cameras("unsupported", kProgram, kPatience);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().message(), "no library: install it");
    const auto hung = list_cameras("hangs", kProgram, 200ms);
    ASSERT_FALSE(hung);
    EXPECT_THAT(hung.error().what, HasSubstr("gave no answer"));
    EXPECT_EQ(children(), 0U);
}

TEST(CameraProcess, that_dies_is_a_camera_that_is_gone_and_the_next_start_has_another) {
    const auto port = camera_called("dies");
    for (int k = 0; k < 2; ++k) {
        Heard heard;
        ASSERT_TRUE(port->start(heard));
        ASSERT_TRUE(heard.wait_for_frames(1));
        EXPECT_TRUE(port->queue(heard.frame(0).buffer));
        ASSERT_TRUE(heard.wait_until_gone());
        const auto refused = port->queue(0);
        ASSERT_FALSE(refused);
        EXPECT_THAT(refused.error().what, HasSubstr("does not run any more"));
        EXPECT_EQ(heard.why(), "is lost: its process hord_fake_camera was killed by signal 6 (Aborted)");
        EXPECT_THAT(heard.cure(), HasSubstr("report it"));
        port->stop();
        EXPECT_EQ(heard.gone(), 1);
        EXPECT_EQ(children(), 0U);
    }
}

TEST(CameraProcess, that_ends_or_is_killed_is_told_as_that_and_not_as_a_cable) {
    for (const bool killed : {true, false}) {
        const auto port = camera_called("exits");
        Heard heard;
        ASSERT_TRUE(port->start(heard));
        ASSERT_TRUE(heard.wait_for_frames(1));
        ASSERT_EQ(children(), 1U);
        if (killed) ::kill(children_pids().front(), SIGKILL);
        else EXPECT_TRUE(port->queue(heard.frame(0).buffer));
        ASSERT_TRUE(heard.wait_until_gone());
        EXPECT_EQ(heard.why(),
                  std::string("is lost: its process hord_fake_camera ") +
                      (killed ? "was killed by signal 9 (Killed)" : "ended with exit status 3"));
        EXPECT_THAT(heard.cure(), AllOf(HasSubstr(killed ? "memory" : "journal"), HasSubstr("reset")));
        port->stop();
        EXPECT_EQ(children(), 0U);
    }
}

// What the station says of it.
TEST(CameraProcess, that_is_killed_is_the_loss_of_the_sensor_with_its_own_cure) {
    const auto loop = std::move(*firmware::SdEventLoop::open());
    auto sensor = CameraPortSensor::open(*loop, {.buffers = 2}, camera_called("works"));
    ASSERT_TRUE(sensor) << sensor.error().message();
    struct Ear final : hal::Sensor::Listener {
        void on_frame(hal::FrameLease) override {}
        void on_sensor_lost(const Error& error) override { lost = error; }
        std::optional<Error> lost;
    } ear;
    ASSERT_TRUE((*sensor)->start(ear));
    ASSERT_EQ(children(), 1U);
    ::kill(children_pids().front(), SIGKILL);
    ASSERT_TRUE(loop->run_until([&] { return ear.lost.has_value(); }, kPatience));
    EXPECT_THAT(ear.lost->message(),
                AllOf(HasSubstr("signal 9 (Killed)"), HasSubstr("journalctl -k"), testing::Not(HasSubstr("cable"))));
    (*sensor)->stop();
}

TEST(CameraProcess, of_a_camera_that_was_unplugged_says_so_and_ends) {
    const auto port = camera_called("unplugged");
    Heard heard;
    ASSERT_TRUE(port->start(heard));
    ASSERT_TRUE(heard.wait_until_gone());
    port->stop();
    EXPECT_EQ(heard.gone(), 1);
    EXPECT_EQ(children(), 0U);
}

TEST(CameraProcess, hands_software_triggers_on_and_says_why_the_camera_is_gone) {
    const auto port = camera_called("works");
    Heard heard;
    ASSERT_TRUE(port->start(heard));
    ASSERT_TRUE(port->trigger());
    ASSERT_TRUE(heard.wait_until_gone());
    EXPECT_EQ(heard.why(), "refused a trigger");
    port->stop();
}

TEST(CameraProcess, that_does_not_stop_is_killed) {
    const auto port = camera_called("does-not-stop");
    Heard heard;
    ASSERT_TRUE(port->start(heard));
    ASSERT_TRUE(heard.wait_for_frames(1));
    port->stop();
    EXPECT_EQ(heard.gone(), 0);
    EXPECT_EQ(children(), 0U);
}

TEST(CameraProcess, that_says_nothing_or_dies_when_asked_is_an_error_and_is_not_left_behind) {
    for (const auto& [name, patience] :
         {std::pair<std::string, hal::Duration>{"hangs", 50ms}, {"dies-when-looked-at", kPatience}}) {
        const auto format = camera_called(name, patience)->look();
        ASSERT_FALSE(format);
        EXPECT_EQ(format.error().code, ErrorCode::io);
        EXPECT_THAT(format.error().message(),
                    AllOf(HasSubstr("hord_fake_camera"), HasSubstr("journal"),
                          HasSubstr(name == "hangs" ? "gave no answer" : "was killed by signal 6 (Aborted)")));
        EXPECT_EQ(children(), 0U);
    }
}

TEST(CameraProcess, says_what_the_camera_said) {
    const auto format = camera_called("unsupported")->look();
    ASSERT_FALSE(format);
    EXPECT_EQ(format.error().code, ErrorCode::unsupported);
    EXPECT_EQ(format.error().what, "it has BGR888");
    EXPECT_EQ(format.error().cure, "set sensor.bits");
}

TEST(CameraProcess, that_names_a_format_whose_rows_do_not_hold_their_samples_is_an_error) {
    const auto loop = std::move(*firmware::SdEventLoop::open());
    const auto sensor = CameraPortSensor::open(*loop, {}, camera_called("impossible"));
    ASSERT_FALSE(sensor);
    EXPECT_THAT(sensor.error().what, HasSubstr("impossible format"));
}

TEST(CameraProcess, that_gives_less_memory_than_it_says_is_an_error) {
    Heard heard;
    const auto memory = camera_called("short-memory")->start(heard);
    ASSERT_FALSE(memory);
    EXPECT_THAT(memory.error().what, HasSubstr("smaller than its process says"));
}

TEST(CameraProcess, whose_program_is_not_there_is_named_with_a_cure) {
    const auto format = open_camera_process({}, "/no/such/hord-camera")->look();
    ASSERT_FALSE(format);
    EXPECT_EQ(format.error().code, ErrorCode::not_found);
    EXPECT_THAT(format.error().message(),
                AllOf(HasSubstr("/no/such/hord-camera"), HasSubstr("install the package again")));
}

// The camera's process may spin. With the timing thread's policy it would block a processor.
TEST(CameraProcess, does_not_have_the_real_time_policy_of_who_starts_it) {
    sched_param param{};
    param.sched_priority = 1;
    if (::sched_setscheduler(0, SCHED_FIFO, &param) != 0)
        GTEST_SKIP() << "this user may take no real-time policy (RLIMIT_RTPRIO)";
    const auto port = camera_called("works");
    Heard heard;
    const auto memory = port->start(heard);
    param.sched_priority = 0;
    ::sched_setscheduler(0, SCHED_OTHER, &param);
    ASSERT_TRUE(memory);
    ASSERT_TRUE(heard.wait_for_frames(1));
    EXPECT_EQ(std::to_integer<int>((**memory)[heard.frame(0).buffer][1]), SCHED_OTHER);
}

TEST(CameraWire, tells_a_command_from_other_arguments) {
    const auto order = parse_camera_arguments(camera_arguments(CameraCommand::start, "{\"camera\":\"a b\"}"));
    ASSERT_TRUE(order);
    EXPECT_EQ(order->command, CameraCommand::start);
    EXPECT_EQ(order->request, "{\"camera\":\"a b\"}");
    for (const std::vector<std::string>& wrong :
         {std::vector<std::string>{}, {"look"}, {"pry", "{}"}, {"look", "{}", "Gain"}})
        EXPECT_FALSE(parse_camera_arguments(wrong));
}

// Converted to an int, the larger ones would be undefined, the smaller one another width.
TEST(CameraWire, takes_no_answer_with_a_number_that_is_not_whole) {
    std::array<int, 2> ends{};
    ASSERT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()), 0);
    const common::UniqueFd here(ends[0]), there(ends[1]);
    ASSERT_TRUE(send_answer(there.get(), CameraAnswer{{640, 480, {}, 640}, {}, {}}));
    std::string text(4096, ' ');
    const ssize_t count = ::recv(here.get(), text.data(), text.size(), 0);
    ASSERT_GT(count, 0);
    text.resize(static_cast<std::size_t>(count));
    const std::string width = "\"width_px\":640";
    ASSERT_NE(text.find(width), std::string::npos) << text;
    const auto answered = [&](const std::string& number) {
        std::string changed = text;
        changed.replace(changed.find(width), width.size(), "\"width_px\":" + number);
        EXPECT_EQ(::send(there.get(), changed.data(), changed.size(), 0), static_cast<ssize_t>(changed.size()));
        return receive_answer(here.get(), std::chrono::seconds(10)).has_value();
    };
    EXPECT_TRUE(answered("641"));
    for (const char* number : {"6.4e2", "640.5", "6e32", "677777777777777777777777777777774"})
        EXPECT_FALSE(answered(number)) << number;
}

}  // namespace
}  // namespace hord::drivers
