// How old the rows of a store are, without trusting the wall clock of the moment.
//
// A day (UTC) is *witnessed* when the wall clock has shown it for ten minutes in one piece, as long by the monotonic
// clock. It is entered in the changes as what = "clock", with the numbers of the newest result and command. Ages are
// counted in these entries. Neither the time of the moment nor the time in a row is used. docs/store.md has the
// reasons.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

struct ClockDay {
    std::int64_t day = 0;                    // since 1970-01-01
    std::int64_t results = 0, commands = 0;  // the newest numbers when it was witnessed
};

// {"day":20780,"date":"2026-11-23","results":9,"commands":2}
std::string to_json_line(const ClockDay& day);
std::optional<ClockDay> clock_day_from(const std::string& json);  // none: it cannot be read

std::string format_day(std::int64_t day);  // "2026-11-23"

// Observes both clocks. One thread.
class ClockWitness {
  public:
    static constexpr std::int64_t kWitnessUs = 600'000'000;
    // Between two observations the clocks may differ by a step of NTP or a thread that comes late, and by a clock that
    // is slewed: a thousandth of the time.
    static constexpr std::int64_t kToleranceUs = 2'000'000, kToleranceParts = 1000;
    // Of the monotonic clock between two entries: a clock that is set again and again makes no days.
    static constexpr std::int64_t kApartUs = 43'200'000'000;

    // Call every minute or so. The day of `now`, if the clock has shown it for long enough and it may be entered.
    std::optional<std::int64_t> observe(const ClockReading& now);
    void entered() { entered_at_us_ = last_->steady_us; }  // after observe(): its day is an entry now

  private:
    std::optional<ClockReading> last_;
    std::optional<std::int64_t> entered_at_us_;  // monotonic
    std::int64_t day_ = 0, shown_us_ = 0;
};

// The witnessed days of a store, in the order of their entries.
class ClockDays {
  public:
    // Entries that date a row, and the newest ones. If at most three of them in a row are of a wrong clock, no row
    // counts as older than it is.
    static constexpr std::size_t kHeld = 7;
    // A longer gap in the calendar of witnessed days is a clock that was set, or a station that was off: it makes
    // nothing older.
    static constexpr std::int64_t kLongestGap = 31;

    void add(const ClockDay& entry);
    [[nodiscard]] std::optional<std::int64_t> newest() const;  // the day that was added last

    // Rows up to `results` and `commands` of `entry` are at least `age_days` old.
    struct Older {
        ClockDay entry;
        std::int64_t age_days = 0;
    };
    // The newest entry whose rows are at least `keep_days` old.
    [[nodiscard]] std::optional<Older> older_than(std::int64_t keep_days) const;

  private:
    // Days from the first witnessed day of the calendar to `day`, without the long gaps. The difference of two
    // positions is never more than that of the two days.
    [[nodiscard]] std::int64_t position(std::int64_t day) const;

    std::vector<ClockDay> entries_;
    std::vector<std::int64_t> calendar_, positions_;  // each day once, ascending, and its position
};

}  // namespace hord::firmware::store
