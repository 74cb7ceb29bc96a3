// The contract of drivers/hal/part_sensor.h, tested on every backend.
#include "tests/system/contract/harness.h"

namespace hord::contract {
namespace {

using namespace std::chrono_literals;
using hal::PartEdge;

struct Ear final : hal::PartSensor::Listener {
    void on_edge(const PartEdge& edge) override {
        edges.push_back(edge);
        if (then) then();
    }
    void on_encoder(const hal::EncoderReading& reading) override { readings.push_back(reading); }
    void on_part_sensor_lost(const Error& error) override { losses.push_back(error); }
    std::vector<PartEdge> edges;
    std::vector<hal::EncoderReading> readings;
    std::vector<Error> losses;
    std::function<void()> then;
};

TEST_P(PartSensorContract, each_part_gives_one_front_and_one_back_edge_numbered_without_a_gap) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    const hal::TimePoint before = h_->now();
    for (std::size_t part = 1; part <= 3; ++part) {
        h_->pass_part();
        ASSERT_TRUE(h_->run_until([&] { return ear.edges.size() >= 2 * part; }));
    }
    ASSERT_EQ(ear.edges.size(), 6U);
    for (std::size_t k = 0; k < 6; ++k) {
        EXPECT_EQ(ear.edges[k].kind, k % 2 == 0 ? PartEdge::Kind::arrives : PartEdge::Kind::leaves);
        EXPECT_EQ(ear.edges[k].sequence, k + 1);
        EXPECT_GE(ear.edges[k].at, k == 0 ? before : ear.edges[k - 1].at);
        EXPECT_LE(ear.edges[k].at, h_->now());
    }
    h_->device().stop();
}

TEST_P(PartSensorContract, encoder_counts_come_with_every_edge_or_with_none_and_grow) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    h_->pass_part();
    ASSERT_TRUE(h_->run_until([&] { return ear.edges.size() >= 2; }));
    EXPECT_EQ(ear.edges[0].counts.has_value(), ear.edges[1].counts.has_value());
    if (ear.edges[0].counts) {
        EXPECT_LT(*ear.edges[0].counts, *ear.edges[1].counts);
        ASSERT_TRUE(h_->run_until([&] { return ear.readings.size() >= 3; }));
        for (std::size_t k = 1; k < ear.readings.size(); ++k)
            EXPECT_GE(ear.readings[k].counts, ear.readings[k - 1].counts);
    } else {
        EXPECT_TRUE(ear.readings.empty());
    }
    h_->device().stop();
}

TEST_P(PartSensorContract, a_second_start_is_refused_and_the_first_goes_on) {
    Ear ear, other;
    ASSERT_TRUE(h_->device().start(ear));
    EXPECT_EQ(code_of(h_->device().start(other)), ErrorCode::invalid_argument);
    h_->pass_part();
    EXPECT_TRUE(h_->run_until([&] { return !ear.edges.empty(); }));
    EXPECT_TRUE(other.edges.empty());
    h_->device().stop();
}

TEST_P(PartSensorContract, nothing_is_heard_after_stop_and_stop_is_harmless_when_not_started) {
    Ear ear;
    h_->device().stop();
    ASSERT_TRUE(h_->device().start(ear));
    h_->device().stop();
    h_->device().stop();
    h_->pass_part();
    h_->run_for(kQuiet);
    EXPECT_TRUE(ear.edges.empty());
    EXPECT_TRUE(ear.losses.empty());
}

TEST_P(PartSensorContract, it_may_be_stopped_from_its_own_callback_and_started_again) {
    Ear ear;
    ear.then = [&] { h_->device().stop(); };
    ASSERT_TRUE(h_->device().start(ear));
    h_->pass_part();
    ASSERT_TRUE(h_->run_until([&] { return !ear.edges.empty(); }));
    h_->run_for(kQuiet);
    EXPECT_EQ(ear.edges.size(), 1U);
    ear.then = nullptr;
    ear.edges.clear();
    ASSERT_TRUE(h_->device().start(ear));
    h_->pass_part();
    ASSERT_TRUE(h_->run_until([&] { return !ear.edges.empty(); }));
    EXPECT_EQ(ear.edges[0].sequence, 1U);  // start() resets the sequence
    h_->device().stop();
}

TEST_P(PartSensorContract, a_loss_is_told_once_and_a_restart_recovers) {
    Ear ear;
    ASSERT_TRUE(h_->device().start(ear));
    if (!h_->lose()) GTEST_SKIP() << "a loss cannot be shown here";
    ASSERT_TRUE(h_->run_until([&] { return !ear.losses.empty(); }));
    h_->run_for(kQuiet);
    EXPECT_EQ(ear.losses.size(), 1U);
    EXPECT_FALSE(ear.losses[0].what.empty());
    h_->device().stop();
    h_->bring_back();
    ear.edges.clear();
    ASSERT_TRUE(h_->run_until([&] { return h_->device().start(ear).has_value(); }));
    h_->pass_part();
    EXPECT_TRUE(h_->run_until([&] { return ear.edges.size() == 2; }));
    h_->device().stop();
}

}  // namespace
}  // namespace hord::contract
