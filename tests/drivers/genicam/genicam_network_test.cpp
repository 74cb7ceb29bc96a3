// Packets that are lost, late or garbage, and a camera that leaves.
#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <random>

#include <netinet/in.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "tests/drivers/genicam/genicam_fixture.h"

namespace hord::drivers {
namespace {

using test::FakeGige;
using testing::AllOf;
using testing::HasSubstr;

// A frame with missing packets is corrupt or missing; none is another one's: the
// samples count the frames as the sequence does.
TEST_F(Genicam, frames_with_lost_packets_are_corrupt_or_missing_and_none_is_taken_for_another) {
    const FakeGige camera({"127.0.0.1", "S1", "lost=0.01"});
    start(software(320, 240));  // 58 packets: about every second frame is complete
    int corrupt = 0, whole = 0;
    std::optional<std::uint8_t> ahead;  // of the sequence: the camera's own number of the frame, its first sample
    std::uint32_t last = 0;
    for (int k = 0; k < 40 && ear_.losses.empty(); ++k) {
        const hal::FrameLease one = frame(1900ms);
        if (!one) continue;
        EXPECT_GT(one.info().sequence, last);
        last = one.info().sequence;
        EXPECT_TRUE(one.info().corrupt ? one.info().bytes_used == 0 : is_one_frame(one.view()));
        if (one.info().corrupt) {
            ++corrupt;
            continue;
        }
        ++whole;
        // A trigger that is sent again on a busy machine makes the camera count on. A frame taken for a later one lags.
        const auto now_ahead = static_cast<std::uint8_t>(one.view().sample(0, 0) - one.info().sequence);
        EXPECT_LT(static_cast<std::uint8_t>(now_ahead - ahead.value_or(now_ahead)), 128);
        ahead = now_ahead;
    }
    EXPECT_TRUE(ear_.losses.empty()) << ear_.losses[0].message();
    EXPECT_GT(corrupt, 0);
    EXPECT_GT(whole, 1);
}

// Every frame loses some. Aravis asks for a quarter of a frame's packets at most: where a busy machine keeps more of
// them back, that frame is damaged.
TEST_F(Genicam, lost_packets_come_again_when_they_are_asked_for_and_are_counted) {
    const FakeGige camera({"127.0.0.1", "S1", "resend=10"});
    testing::internal::CaptureStderr();
    start(software(320, 240));
    int whole = 0;
    for (std::uint32_t k = 1; k <= 12; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(one.info().corrupt || is_one_frame(one.view())) << k;
        whole += one.info().corrupt ? 0 : 1;
    }
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_GE(whole, 8) << said;
    EXPECT_THAT(said, HasSubstr("lost packets are asked for again\n"));
    EXPECT_THAT(said, testing::ContainsRegex("frames complete, .*; [1-9][0-9]+ packets sent again, "));
}

// The rest of each third frame comes when it is asked for; one packet never does.
TEST_F(Genicam, a_packet_that_never_comes_makes_its_frame_damaged_and_is_told) {
    const FakeGige camera({"127.0.0.1", "S1", "resend=10", "never=25"});
    testing::internal::CaptureStderr();
    start(software(320, 240));
    int corrupt = 0;
    for (std::uint32_t k = 1; k <= 9; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(one.info().corrupt ? one.info().bytes_used == 0 : is_one_frame(one.view())) << k;
        if (one.info().corrupt) ++corrupt;
    }
    sensor_->stop();
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_THAT(corrupt, AllOf(testing::Ge(2), testing::Le(6))) << said;
    EXPECT_THAT(said,
                HasSubstr("a frame is damaged: packets of it did not come, although lost ones are asked for again\n"));
    EXPECT_THAT(said, testing::ContainsRegex("[1-9] incomplete, .*; [1-9][0-9]+ packets sent again, [1-9]"));
}

// Packets that come late and out of turn belong to their frames all the same.
TEST_F(Genicam, frames_whose_packets_are_late_and_out_of_turn_are_whole) {
    for (const char* network : {"reorder=5", "delay=30"}) {
        const FakeGige camera({"127.0.0.1", "S1", network});
        start(software(320, 240));
        for (std::uint32_t k = 1; k <= 20; ++k) {
            const hal::FrameLease one = frame();
            ASSERT_TRUE(one) << network << k;
            EXPECT_FALSE(one.info().corrupt) << network << k;
            EXPECT_EQ(one.info().sequence, k);
            EXPECT_TRUE(is_one_frame(one.view())) << network << k;
            EXPECT_GE(one.info().exposure_start, asked_);  // by the camera's clock: a delay does not count
            EXPECT_LE(one.info().exposure_start, loop_->now());
        }
        sensor_->stop();
    }
}

// The same by the kernel, where it has netem.
TEST_F(Genicam, frames_are_whole_behind_netem) {
    if (std::system("tc qdisc replace dev lo root netem delay 2ms 1ms reorder 25% 2>/dev/null") != 0)
        GTEST_SKIP() << "this kernel has no netem (CONFIG_NET_SCH_NETEM), or this user may not use it";
    const FakeGige camera;
    start(software(320, 240));
    for (std::uint32_t k = 1; k <= 20; ++k) {
        const hal::FrameLease one = frame();
        ASSERT_TRUE(one) << k;
        EXPECT_EQ(one.info().sequence, k);
        EXPECT_TRUE(!one.info().corrupt && is_one_frame(one.view())) << k;
    }
    EXPECT_EQ(std::system("tc qdisc del dev lo root"), 0);
}

// A switch that drops what is larger than its MTU.
TEST_F(Genicam, behind_a_small_mtu_a_packet_size_that_does_not_pass_gives_damaged_frames_and_is_said_with_the_cure) {
    const FakeGige camera({"127.0.0.1", "S1", "mtu=1500"});
    for (const int packet_bytes : {0, 9000}) {  // negotiated; as a person set it
        testing::internal::CaptureStderr();
        GenicamSensorOptions options = software(320, 240);
        options.packet_bytes = packet_bytes;
        start(options);
        int corrupt = 0, whole = 0;
        for (int k = 0; k < 4; ++k) {
            const hal::FrameLease one = frame();
            ASSERT_TRUE(one);
            ++(one.info().corrupt ? corrupt : whole);
        }
        sensor_->stop();
        const std::string said = testing::internal::GetCapturedStderr();
        if (packet_bytes == 0) {
            EXPECT_EQ(corrupt, 0);
            EXPECT_THAT(said, testing::Not(HasSubstr("none of the first")));
        } else {
            EXPECT_EQ(whole, 0);
            EXPECT_THAT(said,
                        AllOf(HasSubstr("none of the first 3 frames was complete"), HasSubstr("9000 bytes"),
                              HasSubstr("sensor.packet_bytes to 0"), HasSubstr("MTU")));
        }
    }
}

TEST_F(Genicam, that_leaves_is_lost_and_runs_again_when_it_is_back) {
    FakeGige camera;
    start(software());
    ASSERT_TRUE(frame());
    camera.lose();
    ASSERT_TRUE(sensor_->trigger({.exposure = 2, .start = loop_->now() + 1ms, .length = 1ms}));
    ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); }));
    EXPECT_FALSE(ear_.losses[0].what.empty());
    sensor_->stop();
    EXPECT_EQ(sensor_->start(ear_).error().code, ErrorCode::not_found);
    camera.bring_back();
    const auto started = sensor_->start(ear_);
    ASSERT_TRUE(started) << started.error().message();
    EXPECT_TRUE(frame());
}

TEST_F(Genicam, that_leaves_while_nothing_asks_for_frames_is_lost_too) {
    for (const char* clock : {"still", "latch=no"}) {
        FakeGige camera({"127.0.0.1", "S1", clock});
        start(software());
        camera.lose();
        ear_.losses.clear();
        ASSERT_TRUE(run_until([&] { return !ear_.losses.empty(); })) << clock;
        EXPECT_THAT(ear_.losses[0].what, HasSubstr("it does not answer")) << clock;
    }
}

// The UDP ports of this network but the camera's control port: those of hord-genicam and of the camera's stream.
std::vector<std::uint16_t> open_ports() {
    std::ifstream table("/proc/thread-self/net/udp");
    std::vector<std::uint16_t> ports;
    std::string line;
    for (std::getline(table, line); std::getline(table, line);) {
        unsigned port = 0;
        if (std::sscanf(line.c_str(), " %*d: %*x:%x", &port) == 1 && port != 3956)
            ports.push_back(static_cast<std::uint16_t>(port));
    }
    return ports;
}

// Whatever arrives at the sockets of hord-genicam: frames go on, or the camera is lost and comes back. It may end the
// process (Aravis), never this one.
TEST_F(Genicam, garbage_on_its_network_costs_the_camera_at_most) {
    const FakeGige camera({"127.0.0.1", "S1", "events"});
    GenicamSensorOptions options = software();
    options.barrier_line = "Line1";
    start(options);
    ASSERT_TRUE(frame());
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const std::vector<std::uint16_t> ports = open_ports();
    ASSERT_GE(ports.size(), 2U);
    std::mt19937 random(1);
    const std::array<std::vector<std::uint8_t>, 3> heads{
        {{}, {0, 0, 0, 1, 1, 0, 0, 0}, {0x42, 1, 0, 0xC0, 0, 16, 0, 9, 0, 0, 0x90, 0x11}}};  // none, GVSP, GVCP
    for (int k = 0; k < 3000; ++k) {
        std::vector<std::uint8_t> packet(random() % 1400);
        for (std::uint8_t& byte : packet) byte = static_cast<std::uint8_t>(random());
        const std::vector<std::uint8_t>& head = heads[random() % 3];
        std::copy_n(head.begin(), std::min(head.size(), packet.size()), packet.begin());
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(ports[random() % ports.size()]);
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        (void)::sendto(socket.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                       sizeof to);
    }
    run_until([&] { return !ear_.losses.empty(); }, 500ms);
    ear_.frames.clear();
    sensor_->stop();
    ear_.losses.clear();
    // The camera keeps the control of a process that crashed for its heartbeat time.
    ASSERT_TRUE(run_until([&] { return sensor_->start(ear_).has_value(); }));
    EXPECT_TRUE(frame());
}

}  // namespace
}  // namespace hord::drivers
