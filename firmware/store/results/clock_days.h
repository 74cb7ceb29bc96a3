// How old the rows of a store are, without trusting the wall clock of the moment.
//
// A day (UTC) is *witnessed* when the wall clock has shown it for ten minutes in one piece, as long by the monotonic
// clock. It is entered in the changes as what = "clock", with the numbers of the newest result and command. The age of
// a row is counted in these entries. Neither the time of the moment nor the time in the row is used. docs/store.md has
// the reasons.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

struct ClockDay {
    std::int64_t day = 0;      // since 1970-01-01
    std::int64_t counted = 0;  // days since the entry before, as far as they are believed; may be negative
    std::int64_t results = 0, commands = 0;  // the newest numbers when it was witnessed
};

// {"day":20780,"date":"2026-11-23","counted":1,"results":9,"commands":2}
std::string to_json_line(const ClockDay& day);
std::optional<ClockDay> clock_day_from(const std::string& json);  // none: it cannot be read

std::string format_day(std::int64_t day);  // "2026-11-23"

// A step of the date that a station which was off explains. A longer one is a clock that was set: it counts nothing.
inline constexpr std::int64_t kLongestStepDays = 31;

// Observes both clocks. One thread.
class ClockWitness {
  public:
    static constexpr std::int64_t kWitnessUs = 600'000'000;
    // Between two observations the clocks may differ by a step of NTP or a thread that comes late, and by a clock that
    // is slewed: a thousandth of the time.
    static constexpr std::int64_t kToleranceUs = 2'000'000, kToleranceParts = 1000;

    // Call every minute or so. The day of `now`, if the clock has shown it for long enough.
    std::optional<std::int64_t> observe(const ClockReading& now);

    // How many days count from the witnessed day `before` to `day`, which is witnessed now. At most one more than have
    // passed by the monotonic clock since the last call. Before the first call: at most kLongestStepDays, and none for
    // a longer step.
    std::int64_t count(std::optional<std::int64_t> before, std::int64_t day);

  private:
    std::optional<ClockReading> last_;
    std::optional<std::int64_t> counted_at_us_;  // monotonic
    std::int64_t day_ = 0, shown_us_ = 0;
};

// The witnessed days of a store, in the order of their entries.
class ClockDays {
  public:
    // An error of the clock counts only when it lasts for so many entries.
    static constexpr std::size_t kHeld = 7;

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
    struct Counted {
        ClockDay entry;
        std::int64_t position = 0;  // sum of the counted days up to this entry
        std::int64_t highest = 0;   // the highest position up to this entry
    };
    std::vector<Counted> days_;
};

}  // namespace hord::firmware::store
