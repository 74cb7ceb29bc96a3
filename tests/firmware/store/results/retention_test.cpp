// What is removed for its age, by a clock that may be wrong, and for its size; and what the chain says of it.
#include <random>

#include "firmware/store/results/clock_days.h"
#include "firmware/store/results/export.h"
#include "tests/firmware/store/results/samples.h"
#include "tests/firmware/store/results/sql.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr std::int64_t kFirstDay = kNoon / kDay;

std::vector<StoredChange> changes_of(const TempFolder& folder, const std::string& what) {
    ResultFilter filter;
    filter.what = what;
    return changes(folder, filter);
}

TEST(Retention, removes_what_is_too_old_and_says_what_and_why) {
    const TempFolder folder;
    const auto store = open(folder);
    Calendar calendar;
    const Retention ten_days{.keep_days = 10, .max_bytes = 0};
    Story run;
    ASSERT_TRUE(store->write(run.add_results(1, 200).entries()));
    ASSERT_TRUE(calendar.live(*store, ten_days, 1));
    ASSERT_TRUE(store->write(run.add_results(201, 500).entries()));
    ASSERT_TRUE(calendar.live(*store, ten_days, 9 + 9));
    ASSERT_THAT(results(folder), SizeIs(500));  // nine days old, by the days that are held
    const auto more = calendar.live(*store, ten_days, 1);
    ASSERT_TRUE(more) << more.error().message();
    EXPECT_FALSE(*more);
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(300));
    EXPECT_EQ(all.front().number, 201);
    const Verification verification = verify(folder.path());
    EXPECT_THAT(verification.problems, IsEmpty());
    EXPECT_EQ(verification.heads.back().first, 201);
    EXPECT_EQ(verification.heads.back().number, 500);
    ASSERT_THAT(verification.removed, SizeIs(1));
    EXPECT_THAT(verification.removed[0], HasSubstr("results: retention has removed rows up to 200"));
    const auto removals = changes_of(folder, "retention");
    ASSERT_THAT(removals, SizeIs(1));
    EXPECT_EQ(removals[0].time_us, calendar.now.utc_us - kDay);
    const std::string told = to_table(removals[0]);
    EXPECT_THAT(told, HasSubstr("1 to 200 (" + format_utc(kNoon + 100'000) + " to " + format_utc(kNoon + 20'000'000)));
    EXPECT_THAT(told, HasSubstr("10 days old and more (keep_days 10)"));
    EXPECT_THAT(told, HasSubstr("since " + format_day(kFirstDay)));
}

TEST(Retention, works_in_bounded_steps_and_never_removes_the_newest_row) {
    const TempFolder folder;
    const auto store = open(folder, {.rows_in_one_prune = 200});
    ASSERT_TRUE(store->write(Story().add_results(1, 500).entries()));
    const Retention retention{.keep_days = 1, .max_bytes = 0};
    Calendar calendar;
    ASSERT_TRUE(calendar.live(*store, retention, 10));
    calendar.pass(600 * kSecond);
    ASSERT_TRUE(store->prune({.keep_days = 0, .max_bytes = 0}, calendar.now));
    calendar.pass(600 * kSecond);
    std::vector<std::size_t> left;
    for (bool more = true; more;) {
        more = store->prune(retention, calendar.now).value();
        left.push_back(results(folder).size());
        EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
    }
    EXPECT_THAT(left, ElementsAre(300, 100, 1));
    ASSERT_TRUE(store->write(Story().add_results(1, 501).entries()));
    EXPECT_EQ(results(folder).back().number, 501);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(Retention, may_go_row_by_row) {
    const TempFolder folder;
    const auto store = open(folder, {.rows_in_one_prune = 1});
    ASSERT_TRUE(store->write(Story().add_results(1, 3).entries()));
    Calendar calendar;
    const Retention a_day{.keep_days = 1, .max_bytes = 0};
    const auto more = calendar.live(*store, a_day, 14);
    ASSERT_TRUE(more) << more.error().message();
    EXPECT_FALSE(*more);
    EXPECT_THAT(results(folder), SizeIs(1));
    EXPECT_THAT(changes_of(folder, "retention"), SizeIs(2));
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
}

TEST(Retention, keeps_the_file_under_its_limit_and_gives_space_back) {
    const TempFolder folder;
    const auto store = open(folder);
    constexpr std::uint64_t kLimit = 2'000'000;
    Story run;
    std::uint32_t last = 0;
    std::uintmax_t largest = 0;
    for (int round = 0; round < 10; ++round) {
        run.add_results(last + 1, last + 2000);
        last += 2000;
        ASSERT_TRUE(store->write(run.entries()));
        for (bool more = true; more;)
            more = store->prune({.keep_days = 0, .max_bytes = kLimit}, ClockReading{kNoon, 0}).value();
        if (round >= 6)
            largest = std::max(largest,
                               sql_integer(folder,
                                           "SELECT (page_count - freelist_count) * page_size FROM pragma_page_count, "
                                           "pragma_freelist_count, pragma_page_size"));
    }
    EXPECT_LE(largest, kLimit);
    EXPECT_EQ(results(folder).back().sequence, last);
    EXPECT_GT(results(folder).size(), 4000U);  // what fits is kept
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
    EXPECT_THAT(to_table(changes_of(folder, "retention").back()), HasSubstr("(keep_mb 2)"));
}

TEST(Retention, by_size_never_removes_the_newest_row_however_small_the_limit) {
    const TempFolder folder;
    const auto store = open(folder);
    ASSERT_TRUE(store->write(Story().add_results(1, 500).entries()));
    for (bool more = true; more;) more = store->prune({.keep_days = 0, .max_bytes = 1}, ClockReading{kNoon, 0}).value();
    const auto left = results(folder);
    ASSERT_THAT(left, SizeIs(1));
    EXPECT_EQ(left[0].number, 500);
    EXPECT_THAT(verify(folder.path()).problems, IsEmpty());
    const auto removals = changes_of(folder, "retention");
    ASSERT_THAT(removals, SizeIs(1));
    EXPECT_THAT(removals[0].after,
                HasSubstr(R"({"from":1,"to":499,"first_time":"2026-09-21T14:13:20.100Z",)"
                          R"("last_time":"2026-09-21T14:14:09.900Z","hash":")"));
}

// With what was removed before still in the file: pages that are free do not count.
TEST(Retention, removes_no_more_than_is_above_the_limit) {
    const TempFolder folder;
    const auto store = open(folder);
    ASSERT_TRUE(store->write(Story().add_results(1, 4000).entries()));
    const std::uint64_t used = sql_integer(folder,
                                           "SELECT (page_count - freelist_count) * page_size FROM pragma_page_count, "
                                           "pragma_freelist_count, pragma_page_size");
    ASSERT_TRUE(store->prune({.keep_days = 0, .max_bytes = used}, ClockReading{kNoon, 0}));
    EXPECT_EQ(results(folder).size(), 4000U) << "the limit itself is not above it";
    ASSERT_TRUE(store->prune({.keep_days = 0, .max_bytes = used * 9 / 10}, ClockReading{kNoon, 0}));
    const std::size_t left = results(folder).size();
    EXPECT_LT(left, 3700U);
    EXPECT_GT(left, 3400U);
    ASSERT_TRUE(store->prune({.keep_days = 0, .max_bytes = used * 95 / 100}, ClockReading{kNoon, 0}));
    EXPECT_EQ(results(folder).size(), left);
}

TEST(ClockDays, a_gap_of_the_longest_length_makes_older_and_a_longer_one_does_not) {
    for (const std::int64_t longer : {0, 1}) {
        ClockDays days;
        std::int64_t day = 93, results = 0;
        for (int k = 0; k < 7; ++k) days.add({++day, ++results, 0});
        day += ClockDays::kLongestGap + longer - 1;
        for (int k = 0; k < 7; ++k) days.add({++day, ++results, 0});
        EXPECT_EQ(days.older_than(ClockDays::kLongestGap).has_value(), longer == 0);
    }
}

// -- wrong clocks

// The station of the issue: 999 results and 35 commands, each day some, kept for 400 days.
struct Station {
    Station() : store(open(folder)) {
        for (std::uint32_t day = 0; day < 35; ++day) {
            run.add_results(day * 28 + 1, day * 28 + 28);
            run.add(ChangeRecord{ChangeRecord::What::command, kNoon + day * kDay, "plc:1", day + 1, "stop", "", ""});
            EXPECT_TRUE(store->write(run.entries()));
            EXPECT_TRUE(calendar.live(*store, retention, 1));
        }
    }
    [[nodiscard]] std::size_t rows() const {
        ResultFilter filter;
        filter.what = "command";
        return results(folder).size() + changes(folder, filter).size();
    }
    TempFolder folder;
    std::unique_ptr<ResultStore> store;
    Retention retention{.keep_days = 400, .max_bytes = 0};
    Calendar calendar;
    Story run;
};

TEST(Retention, by_a_clock_two_years_ahead_for_70_seconds_removes_nothing) {
    Station station;
    ASSERT_EQ(station.rows(), 35U * 29);
    station.calendar.now.utc_us += 730 * kDay;
    for (int k = 0; k < 8; ++k) {
        ASSERT_TRUE(station.store->prune(station.retention, station.calendar.now));
        station.calendar.pass(10 * kSecond);
    }
    EXPECT_EQ(station.rows(), 35U * 29);
    EXPECT_THAT(verify(station.folder.path()).problems, IsEmpty());
}

TEST(Retention, by_a_clock_years_ahead_or_behind_for_weeks_removes_nothing) {
    for (const int years : {2, -2, -56}) {
        Station station;
        const UtcMicros wrong = years * 365 * kDay;
        station.calendar.now.utc_us += wrong;
        ASSERT_TRUE(station.calendar.live(*station.store, station.retention, 20));
        EXPECT_EQ(station.rows(), 35U * 29) << years;
        station.calendar.now.utc_us -= wrong;
        ASSERT_TRUE(station.calendar.live(*station.store, station.retention, 20));
        EXPECT_EQ(station.rows(), 35U * 29) << years;
    }
}

TEST(Retention, goes_on_after_a_clock_was_ahead_and_after_a_long_pause) {
    for (const bool comes_back : {true, false}) {
        Station station;
        station.retention.keep_days = 40;
        station.calendar.now.utc_us += 730 * kDay;
        ASSERT_TRUE(station.calendar.live(*station.store, station.retention, 3));
        if (comes_back) station.calendar.now.utc_us -= 730 * kDay;
        ASSERT_TRUE(station.calendar.live(*station.store, station.retention, 40));
        EXPECT_LT(station.rows(), 25U * 29) << comes_back;
        EXPECT_GT(station.rows(), 0U);
        EXPECT_THAT(verify(station.folder.path()).problems, IsEmpty());
    }
}

TEST(Retention, does_not_believe_a_clock_that_is_set_a_month_ahead_every_hour) {
    Station station;
    for (int k = 0; k < 60; ++k) {
        ASSERT_TRUE(station.calendar.witness(*station.store, station.retention));
        station.calendar.pass(3600 * kSecond);
        station.calendar.now.utc_us += 30 * kDay;
    }
    EXPECT_EQ(station.rows(), 35U * 29);
}

// Days of operation with pauses, restarts and wrong clocks: by days, weeks or years, ahead and behind, each for three
// days at most. No row is removed before its true time.
TEST(Retention, by_a_clock_that_is_often_wrong_removes_no_row_too_early) {
    std::size_t removed_in_all = 0;
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        std::mt19937_64 random(seed);
        const auto below = [&](std::uint64_t limit) { return static_cast<std::int64_t>(random() % limit); };
        ClockDays days;
        const std::int64_t keep = 20 + below(100);
        std::vector<std::int64_t> true_day_of_row;  // by number
        std::int64_t removed = 0, today = kFirstDay, wrong = 0, wrong_for = 0;
        for (int k = 0; k < 400; ++k) {
            today += below(8) == 0 ? below(20) : 1;
            for (int rows = 0; rows < 3; ++rows) true_day_of_row.push_back(today);
            if (wrong_for > 0) --wrong_for;
            else if (wrong != 0) wrong = 0, wrong_for = -10;  // right for some days
            else if (++wrong_for > 0 && below(5) == 0) {
                constexpr std::int64_t kSizes[] = {1, 5, 20, 31, 60, 730, 20'000};
                wrong = kSizes[below(7)] * (below(2) == 0 ? 1 : -1);
                wrong_for = below(3);  // and this day: three at most
            }
            const std::int64_t shown = std::max<std::int64_t>(today + wrong, 0);
            const auto rows = static_cast<std::int64_t>(true_day_of_row.size());
            if (shown != days.newest()) days.add({shown, rows, 0});
            const auto older = days.older_than(keep);
            if (!older) continue;
            for (; removed < older->entry.results; ++removed) {
                ASSERT_GE(today - true_day_of_row[static_cast<std::size_t>(removed)], keep)
                    << "seed " << seed << ", day " << k << ", row " << removed;
            }
        }
        removed_in_all += static_cast<std::size_t>(removed);
    }
    EXPECT_GT(removed_in_all, 300U * 400);  // of 1200 rows a seed: most of those that are old enough
}

TEST(ClockWitness, wants_ten_minutes_of_one_clock_in_one_piece) {
    ClockWitness witness;
    ClockReading now{kNoon, 0};
    const auto minute = [&](UtcMicros extra_us = 0) {
        now.utc_us += 60 * kSecond + extra_us;
        now.steady_us += 60 * kSecond;
        return witness.observe(now).has_value();
    };
    EXPECT_FALSE(witness.observe(now));
    for (int k = 0; k < 9; ++k) EXPECT_FALSE(minute());
    EXPECT_FALSE(minute(5 * kSecond));                          // set
    for (int k = 0; k < 9; ++k) EXPECT_FALSE(minute(kSecond));  // slewed
    EXPECT_TRUE(minute());
    witness.entered();
    now.utc_us += kDay;
    for (int k = 0; k < 100; ++k) EXPECT_FALSE(minute());  // the next day by a clock that was set
    for (int k = 0; k < 12 * 60 - 101; ++k) (void)minute();
    EXPECT_TRUE(minute());
}

TEST(ClockWitness, names_the_day_of_the_wall_clock) {
    for (const std::int64_t day : {std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}, kFirstDay, kFirstDay + 4000}) {
        for (const UtcMicros of_day : {UtcMicros{0}, kDay - ClockWitness::kWitnessUs}) {
            ClockWitness witness;
            EXPECT_FALSE(witness.observe({day * kDay + of_day, 0}));
            const UtcMicros end = day * kDay + of_day + ClockWitness::kWitnessUs - (of_day == 0 ? 0 : 1);
            EXPECT_EQ(witness.observe({end, ClockWitness::kWitnessUs}), day) << of_day;
        }
    }
}

// Two clocks that differ by two seconds and a thousandth of the time agree; by more they do not.
TEST(ClockWitness, bears_a_clock_that_is_stepped_or_slewed_a_little_both_ways) {
    constexpr std::int64_t kHour = 3600 * kSecond, kSlack = ClockWitness::kToleranceUs + kHour / 1000;
    for (const std::int64_t off : {kSlack, kSlack + 1, -kSlack, -kSlack - 1}) {
        ClockWitness witness;
        EXPECT_FALSE(witness.observe({kFirstDay * kDay + kHour, 0}));
        EXPECT_EQ(witness.observe({kFirstDay * kDay + 2 * kHour + off, kHour}).has_value(), std::abs(off) <= kSlack)
            << off;
    }
}

TEST(ClockWitness, counts_of_a_new_day_only_what_it_has_shown_of_it) {
    constexpr std::int64_t kTen = ClockWitness::kWitnessUs;
    for (const std::int64_t early : {0, 1}) {
        ClockWitness witness;
        EXPECT_FALSE(witness.observe({(kFirstDay + 1) * kDay - kTen, 0}));
        EXPECT_EQ(witness.observe({(kFirstDay + 1) * kDay + kTen - early, 2 * kTen - early}),
                  early == 0 ? std::optional(kFirstDay + 1) : std::nullopt);
        EXPECT_EQ(witness.observe({(kFirstDay + 1) * kDay + kTen, 2 * kTen}), kFirstDay + 1) << "and it goes on";
    }
}

TEST(ClockWitness, lets_half_a_day_pass_between_two_entries) {
    ClockWitness witness;
    (void)witness.observe({kFirstDay * kDay, 0});
    ASSERT_TRUE(witness.observe({kFirstDay * kDay + kDay / 4, kDay / 4}));
    witness.entered();
    const auto at = [&](std::int64_t steady_us) {
        return witness.observe({kFirstDay * kDay + steady_us, steady_us}).has_value();
    };
    EXPECT_FALSE(at(kDay / 4 + ClockWitness::kApartUs - 1));
    EXPECT_TRUE(at(kDay / 4 + ClockWitness::kApartUs));
}

TEST(ClockDays, are_read_back_up_to_the_last_day_of_year_9999) {
    const auto day = [](std::int64_t number) {
        return clock_day_from(R"({"day":)" + std::to_string(number) + R"(,"results":1,"commands":2})");
    };
    EXPECT_EQ(day(2'932'896)->commands, 2);
    EXPECT_EQ(format_day(2'932'896), "9999-12-31");
    EXPECT_FALSE(day(2'932'897));
    EXPECT_FALSE(day(-1));
    EXPECT_FALSE(clock_day_from(R"({"day":5,"results":1,"commands":-1})"));
    EXPECT_FALSE(clock_day_from(R"({"day":5,"results":1})"));
    EXPECT_EQ(to_json_line(ClockDay{20'783, 9, 2}), R"({"day":20783,"date":"2026-11-26","results":9,"commands":2})");
}

TEST(ClockDays, know_the_day_that_was_added_last) {
    ClockDays days;
    EXPECT_FALSE(days.newest());
    days.add({9, 1, 0});
    days.add({7, 2, 0});
    EXPECT_EQ(days.newest(), 7);
}

TEST(ClockDays, with_a_damaged_number_removes_nothing_that_a_later_day_has) {
    ClockDays days;
    days.add({kFirstDay, 1'000'000, 5});
    for (int k = 1; k <= 30; ++k) days.add({kFirstDay + k, 10 * k, k});
    EXPECT_EQ(days.older_than(21)->entry.results, 10);  // dated by the middle of seven, 24 days after the first
    EXPECT_FALSE(days.older_than(22));
    EXPECT_FALSE(clock_day_from(R"({"day":"x","date":"","results":1,"commands":1})"));
    EXPECT_FALSE(clock_day_from(R"({"day":5,"results":-1,"commands":1})"));
    EXPECT_EQ(format_day(20'783), "2026-11-26");
    EXPECT_THAT(to_json_line({20'783, 0, 0}), ::testing::HasSubstr("\"2026-11-26\""));
    const ClockDay day{kFirstDay, 7, 8};
    EXPECT_EQ(clock_day_from(to_json_line(day))->results, 7);
    EXPECT_TRUE(clock_day_from(to_json_line({0, 0, 0}))) << "1970-01-01, and nothing stored so far";
}

// What is older, computed anew for each day: its date is the median of seven entries from it on, not before that of any
// earlier one; its age counts the gaps between known days, unless they are too long.
std::optional<ClockDays::Older> older_by_hand(const std::vector<ClockDay>& entries, std::int64_t keep_days) {
    constexpr std::size_t kSeven = 7;
    if (entries.size() < kSeven) return std::nullopt;
    std::vector<std::int64_t> known;
    for (const ClockDay& entry : entries) known.push_back(entry.day);
    std::sort(known.begin(), known.end());
    const auto age = [&](std::int64_t from, std::int64_t to) {
        std::int64_t sum = 0;
        for (std::size_t k = 1; k < known.size(); ++k) {
            const std::int64_t gap = known[k] - known[k - 1];
            if (known[k - 1] >= from && known[k] <= to && gap <= ClockDays::kLongestGap) sum += gap;
        }
        return sum;
    };
    std::int64_t today = entries.back().day, latest = 0;
    for (std::size_t k = entries.size() - kSeven; k < entries.size(); ++k) today = std::min(today, entries[k].day);
    std::optional<ClockDays::Older> older;
    for (std::size_t k = 0; k + kSeven <= entries.size(); ++k) {
        std::vector<std::int64_t> held;
        for (std::size_t i = k; i < k + kSeven; ++i) held.push_back(entries[i].day);
        std::sort(held.begin(), held.end());
        latest = std::max(latest, held[3]);
        if (latest > today || age(latest, today) < keep_days) break;
        ClockDay entry = entries[k];
        for (const ClockDay& later : entries) {  // numbers only grow: a later lower one is right
            if (&later <= &entries[k]) continue;
            entry.results = std::min(entry.results, later.results);
            entry.commands = std::min(entry.commands, later.commands);
        }
        older = ClockDays::Older{entry, age(latest, today)};
    }
    return older;
}

TEST(ClockDays, are_older_as_the_median_of_seven_entries_says) {
    std::uint32_t state = 20261126;
    const auto draw = [&](std::uint32_t below) { return (state = state * 1664525U + 1013904223U) / 65'536U % below; };
    int some = 0;
    for (int story = 0; story < 300; ++story) {
        ClockDays days;
        std::vector<ClockDay> entries;
        std::int64_t day = draw(2) == 0 ? 0 : 20'000, results = 0, commands = 0;
        const std::uint32_t count = 1 + draw(40);
        for (std::uint32_t k = 0; k < count; ++k) {
            day += draw(8) == 0 ? draw(60) : draw(3);
            const std::int64_t shown = draw(5) == 0 ? std::max<std::int64_t>(0, day + draw(40) - 20) : day;
            const std::int64_t damage = draw(12) == 0 ? draw(1000) : 0;
            entries.push_back({shown, (results += draw(100)) + damage, (commands += draw(3)) + damage / 100});
            days.add(entries.back());
        }
        for (const std::int64_t keep : {0, 1, 7, 30, 100}) {
            const auto older = days.older_than(keep), by_hand = older_by_hand(entries, keep);
            ASSERT_EQ(older.has_value(), by_hand.has_value()) << story << " " << keep;
            if (!older) continue;
            ++some;
            EXPECT_EQ(older->entry.results, by_hand->entry.results) << story << " " << keep;
            EXPECT_EQ(older->entry.commands, by_hand->entry.commands) << story << " " << keep;
            EXPECT_EQ(older->age_days, by_hand->age_days) << story << " " << keep;
        }
    }
    EXPECT_GT(some, 200);
}

}  // namespace
}  // namespace hord::firmware::store::test
