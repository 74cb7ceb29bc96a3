#include "drivers/gpio/edge_filter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;
using hal::TimePoint;
using testing::ElementsAre;
using testing::IsEmpty;

constexpr TimePoint at(hal::Duration t) { return TimePoint(10s + t); }
testing::Matcher<const EdgeFilter::Edge&> edge(bool active, hal::Duration t, std::uint32_t sequence) {
    return testing::AllOf(testing::Field(&EdgeFilter::Edge::active, active),
                          testing::Field(&EdgeFilter::Edge::at, at(t)),
                          testing::Field(&EdgeFilter::Edge::sequence, sequence));
}

struct EdgeFilterTest : testing::Test {
    EdgeFilter filter{200us, 50ms, false};
    std::vector<EdgeFilter::Edge> edges;
    void feed(bool active, hal::Duration t, std::uint32_t lost = 0) { filter.feed({active, at(t), lost}, edges); }
    void settle(bool active, hal::Duration t) { filter.settle(at(t), active, edges); }
};

TEST_F(EdgeFilterTest, an_edge_counts_when_the_line_kept_still_and_keeps_its_own_time) {
    feed(true, 0us);
    EXPECT_EQ(filter.due(), at(200us));
    settle(true, 199us);
    EXPECT_THAT(edges, IsEmpty());
    settle(true, 200us);
    EXPECT_THAT(edges, ElementsAre(edge(true, 0us, 1)));
    EXPECT_EQ(filter.due(), std::nullopt);
}

TEST_F(EdgeFilterTest, a_bouncing_edge_is_one_edge_at_the_time_of_the_first_bounce) {
    for (int k = 0; k < 7; ++k) feed(k % 2 == 0, k * 50us);
    EXPECT_EQ(filter.due(), at(500us));
    settle(true, 500us);
    EXPECT_THAT(edges, ElementsAre(edge(true, 0us, 1)));
}

TEST_F(EdgeFilterTest, edges_that_are_read_late_are_separated_by_their_time_stamps) {
    feed(true, 0us);
    feed(false, 2ms);
    feed(true, 30ms);
    feed(false, 32ms);
    settle(false, 40ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 0us, 1), edge(false, 2ms, 2), edge(true, 30ms, 3), edge(false, 32ms, 4)));
}

TEST_F(EdgeFilterTest, a_spike_that_is_over_within_the_debounce_is_no_part) {
    feed(true, 0us);
    feed(false, 60us);
    settle(false, 260us);
    EXPECT_THAT(edges, IsEmpty());
}

TEST_F(EdgeFilterTest, edges_that_the_kernel_lost_leave_a_gap) {
    feed(true, 0us);
    settle(true, 1ms);
    feed(false, 2ms, 4);
    settle(false, 3ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 0us, 1), edge(false, 2ms, 6)));
}

TEST_F(EdgeFilterTest, a_part_whose_edges_were_both_read_too_late_to_see_it_leaves_a_gap_before_the_next) {
    feed(false, 0us);  // the line rose and fell before the kernel read the level
    settle(false, 1ms);
    EXPECT_THAT(edges, IsEmpty());
    feed(true, 30ms);
    settle(true, 31ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 30ms, 3)));
}

TEST_F(EdgeFilterTest, a_level_without_an_edge_is_an_edge_with_a_gap) {
    settle(true, 5ms);
    EXPECT_THAT(edges, IsEmpty());  // its edge may still be queued
    settle(true, 55ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 55ms, 2)));
    settle(true, 105ms);
    EXPECT_EQ(edges.size(), 1U);
}

TEST_F(EdgeFilterTest, a_level_that_an_edge_explained_is_waited_for_anew) {
    settle(true, 5ms);
    feed(true, 6ms);
    feed(false, 6050us);
    settle(false, 7ms);
    settle(true, 30ms);
    EXPECT_THAT(edges, IsEmpty());
    settle(true, 50ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 50ms, 2)));
}

TEST_F(EdgeFilterTest, a_level_whose_edge_is_still_queued_is_no_loss) {
    settle(true, 5ms);
    feed(true, 5ms);
    settle(true, 6ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 5ms, 1)));
    feed(false, 40ms);
    settle(true, 41ms);  // it rose again: that edge is queued
    feed(true, 41ms);
    settle(true, 42ms);
    feed(false, 60ms);
    settle(false, 61ms);
    EXPECT_THAT(edges,
                ElementsAre(edge(true, 5ms, 1), edge(false, 40ms, 2), edge(true, 41ms, 3), edge(false, 60ms, 4)));
}

TEST_F(EdgeFilterTest, the_level_decides_when_the_last_edge_was_read_too_late) {
    feed(false, 0us);  // it rose, but the kernel read the low level of a bounce
    settle(true, 200us);
    EXPECT_THAT(edges, IsEmpty());
    EXPECT_EQ(filter.due(), at(200us) + EdgeFilter::kRecheckAfter);
    settle(true, 30ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 0us, 1)));
}

TEST_F(EdgeFilterTest, each_change_without_an_edge_is_looked_at_twice) {
    settle(true, 5ms);
    settle(true, 25ms);
    ASSERT_THAT(edges, ElementsAre(edge(true, 25ms, 2)));
    settle(false, 60ms);
    EXPECT_EQ(edges.size(), 1U) << "its edge may be queued";
    settle(false, 80ms);
    EXPECT_THAT(edges, ElementsAre(edge(true, 25ms, 2), edge(false, 80ms, 4)));
}

TEST_F(EdgeFilterTest, a_line_that_does_not_settle_bounces_too_long) {
    for (int k = 0; k <= 500; ++k) feed(k % 2 == 0, k * 100us);
    EXPECT_FALSE(filter.bouncing_too_long());
    feed(false, 50'100us);
    EXPECT_TRUE(filter.bouncing_too_long());
    EXPECT_THAT(edges, IsEmpty());
}

TEST_F(EdgeFilterTest, without_debounce_every_edge_counts_at_once) {
    EdgeFilter raw{0ns, 50ms, true};
    raw.feed({false, at(0us), 0}, edges);
    EXPECT_EQ(raw.due(), at(0us));
    raw.settle(at(0us), false, edges);
    EXPECT_THAT(edges, ElementsAre(edge(false, 0us, 1)));
}

TEST(EncoderTrack, gives_the_position_at_a_time) {
    EncoderTrack track;
    EXPECT_EQ(track.counts_at(at(0us)), 0);
    for (int k = 1; k <= 5; ++k) track.count(at(k * 1ms));
    EXPECT_EQ(track.counts(), 5);
    EXPECT_EQ(track.counts_at(at(0us)), 0);
    EXPECT_EQ(track.counts_at(at(3ms)), 3);
    EXPECT_EQ(track.counts_at(at(3999us)), 3);
    EXPECT_EQ(track.counts_at(at(1s)), 5);
}

TEST(EncoderTrack, gives_none_before_its_history) {
    EncoderTrack track;
    const auto last = static_cast<int>(EncoderTrack::kHistory) + 10;
    for (int k = 1; k <= last; ++k) track.count(at(k * 1us));
    EXPECT_EQ(track.counts_at(at(11us)), 11);
    EXPECT_EQ(track.counts_at(at(10us)), std::nullopt);
}

}  // namespace
}  // namespace hord::drivers
