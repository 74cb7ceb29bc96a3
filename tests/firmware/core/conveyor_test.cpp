// Place and speed of the conveyor from the readings of its encoder.
#include "firmware/core/conveyor.h"

#include <limits>

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {
namespace {

TEST(Conveyor, of_which_nothing_is_known_reaches_no_count) {
    const TimePoint t0(std::chrono::seconds(1));
    Conveyor c;
    c.read(t0, 500);
    EXPECT_EQ(c.reaches(501), TimePoint::max()) << "one reading is no speed";
    EXPECT_EQ(c.reaches(500), t0);
    c.read(t0 + milliseconds(10), 600);
    c.forget();
    EXPECT_FALSE(c.known());
    EXPECT_FALSE(c.reached(0));
    EXPECT_EQ(c.reaches(-1), TimePoint::max());
    EXPECT_EQ(c.reaches(0), TimePoint::max());
    EXPECT_EQ(c.counts_at(t0), 0);
}

TEST(Conveyor, counts_of_more_than_a_lifetime_are_not_plausible) {
    EXPECT_TRUE(Conveyor::plausible(Conveyor::kPlausible - 1));
    EXPECT_FALSE(Conveyor::plausible(Conveyor::kPlausible));
    EXPECT_TRUE(Conveyor::plausible(1 - Conveyor::kPlausible));
    EXPECT_FALSE(Conveyor::plausible(-Conveyor::kPlausible));
}

TEST(Conveyor, readings_four_milliseconds_apart_give_a_speed) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    c.read(t0, 0);
    c.read(t0 + milliseconds(4) - Duration(1), 40);
    EXPECT_EQ(c.reaches(80), TimePoint::max());
    c.read(t0 + milliseconds(4), 40);
    EXPECT_EQ(c.reaches(80), t0 + milliseconds(8));
}

TEST(Conveyor, too_fast_to_be_extrapolated_is_taken_to_stand) {
    constexpr std::int64_t kStepsAnHour = 900'000;  // of 4 ms
    const TimePoint t0(std::chrono::seconds(1)), last = t0 + milliseconds(4), later = last + std::chrono::hours(1);
    const std::int64_t fastest = Conveyor::kPlausible / kStepsAnHour;
    Conveyor fast, too_fast;
    for (Conveyor* c : {&fast, &too_fast}) c->read(t0, 0);
    fast.read(last, fastest);
    too_fast.read(last, fastest * 11 / 10);
    EXPECT_EQ(fast.counts_at(later), fastest * (kStepsAnHour + 1));
    EXPECT_EQ(too_fast.counts_at(later), fastest * 11 / 10);
}

TEST(Conveyor, that_moves_by_one_count_between_readings_moves) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    c.read(t0, 0);
    c.read(t0 + milliseconds(10), 1);
    EXPECT_EQ(c.reaches(3), t0 + milliseconds(30));
    EXPECT_EQ(c.counts_at(t0 + milliseconds(30)), 3);
}

TEST(Conveyor, one_count_microseconds_after_a_reading_is_no_speed) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    c.read(t0, 0);
    c.read(t0 + milliseconds(10), 100);
    c.read(t0 + milliseconds(10) + microseconds(10), 101);  // an edge with its count
    EXPECT_EQ(c.reaches(201), t0 + milliseconds(20) + microseconds(10));
}

TEST(Conveyor, extrapolates_the_last_two_readings_and_never_overflows) {
    Conveyor c;
    const TimePoint t0(std::chrono::seconds(1));
    EXPECT_EQ(c.reaches(100), TimePoint::max());
    c.read(t0, 0);
    EXPECT_EQ(c.reaches(100), TimePoint::max());
    c.read(t0 + milliseconds(10), 100);
    EXPECT_EQ(c.reaches(150), t0 + milliseconds(15));
    EXPECT_EQ(c.reaches(50), t0 + milliseconds(5));
    EXPECT_EQ(c.counts_at(t0 + milliseconds(20)), 200);
    EXPECT_EQ(c.reaches(std::int64_t{1} << 60), TimePoint::max());
    const TimePoint last = t0 + milliseconds(10);
    const std::int64_t in_an_hour = 36'000'000;
    EXPECT_EQ(c.reaches(100 + in_an_hour), last + std::chrono::hours(1));
    EXPECT_EQ(c.reaches(100 + 10'000), last + std::chrono::seconds(1));
    EXPECT_EQ(c.reaches(100 - 10'000), last - std::chrono::seconds(1));
    EXPECT_EQ(c.reaches(100 - in_an_hour - 50), last - std::chrono::hours(1) - milliseconds(5));
    EXPECT_EQ(c.reaches(100 - 2 * in_an_hour), last - std::chrono::hours(1)) << "no further back";
    EXPECT_EQ(c.counts_at(last + std::chrono::hours(1)), 100 + in_an_hour);
    EXPECT_EQ(c.counts_at(last + std::chrono::hours(2)), 100 + in_an_hour) << "not extrapolated any further";
    EXPECT_EQ(c.counts_at(last - std::chrono::hours(2)), 100 - in_an_hour);
    c.read(t0 + milliseconds(20), 90);  // a decreasing count is treated as a standstill
    EXPECT_EQ(c.reaches(91), TimePoint::max());
    c.read(t0 + milliseconds(20), 500);  // not newer than the last reading
    EXPECT_EQ(c.reaches(100), TimePoint::max());
}

}  // namespace
}  // namespace hord::firmware
