#include "firmware/store/results/clock_days.h"

#include <algorithm>
#include <cstdlib>

#include "firmware/store/results/export.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::store {
namespace {

constexpr std::int64_t kDayUs = 86'400'000'000;
constexpr std::int64_t kLastDay = 2'932'896;  // 9999-12-31

std::int64_t day_of(UtcMicros time_us) { return time_us / kDayUs - (time_us % kDayUs < 0 ? 1 : 0); }

}  // namespace

std::string format_day(std::int64_t day) { return format_utc(day * kDayUs).substr(0, 10); }

std::string to_json_line(const ClockDay& day) {
    return to_text({{"day", day.day},
                    {"date", format_day(day.day)},
                    {"counted", day.counted},
                    {"results", day.results},
                    {"commands", day.commands}});
}

std::optional<ClockDay> clock_day_from(const std::string& json) {
    const Json read = parse_stored(json);
    ClockDay day;
    for (auto [name, value] : {std::pair("day", &day.day), std::pair("counted", &day.counted),
                               std::pair("results", &day.results), std::pair("commands", &day.commands)}) {
        const auto found = integer_in(read, name);
        if (!found) return std::nullopt;
        *value = *found;
    }
    const bool possible = std::abs(day.counted) <= kLongestStepDays && day.day >= 0 && day.day <= kLastDay &&
        day.results >= 0 && day.commands >= 0;
    return possible ? std::optional(day) : std::nullopt;
}

std::optional<std::int64_t> ClockWitness::observe(const ClockReading& now) {
    const std::int64_t day = day_of(now.utc_us);
    if (last_) {
        const std::int64_t passed = now.steady_us - last_->steady_us, moved = now.utc_us - last_->utc_us;
        const bool agree = std::abs(moved - passed) <= kToleranceUs + passed / kToleranceParts;
        if (!agree) shown_us_ = 0;
        else if (day == day_) shown_us_ += passed;
        else shown_us_ = std::min(passed, now.utc_us - day * kDayUs);
    }
    last_ = now;
    day_ = day;
    return shown_us_ >= kWitnessUs ? std::optional(day) : std::nullopt;
}

std::int64_t ClockWitness::count(std::optional<std::int64_t> before, std::int64_t day) {
    const std::int64_t now_us = last_ ? last_->steady_us : 0;
    const std::int64_t step = before ? day - *before : 0;
    std::int64_t most = std::abs(step) > kLongestStepDays ? 0 : kLongestStepDays;
    if (counted_at_us_) most = std::min(kLongestStepDays, 1 + (now_us - *counted_at_us_) / kDayUs);
    counted_at_us_ = now_us;
    return std::clamp(step, -most, most);
}

void ClockDays::add(const ClockDay& entry) {
    Counted counted{entry, entry.counted, entry.counted};
    if (!days_.empty()) {
        counted.position = days_.back().position + entry.counted;
        counted.highest = std::max(days_.back().highest, counted.position);
    }
    days_.push_back(counted);
    // Numbers only grow. An entry with a higher one than a later entry is damaged.
    for (auto day = days_.rbegin() + 1; day != days_.rend(); ++day) {
        if (day->entry.results <= entry.results && day->entry.commands <= entry.commands) break;
        day->entry.results = std::min(day->entry.results, entry.results);
        day->entry.commands = std::min(day->entry.commands, entry.commands);
    }
}

std::optional<std::int64_t> ClockDays::newest() const {
    return days_.empty() ? std::nullopt : std::optional(days_.back().entry.day);
}

std::optional<ClockDays::Older> ClockDays::older_than(std::int64_t keep_days) const {
    if (days_.size() < kHeld) return std::nullopt;
    std::int64_t today = days_.back().position;
    for (std::size_t k = days_.size() - kHeld; k < days_.size(); ++k) today = std::min(today, days_[k].position);
    for (auto day = days_.rbegin(); day != days_.rend(); ++day) {
        if (today - day->highest >= keep_days) return Older{day->entry, today - day->highest};
    }
    return std::nullopt;
}

}  // namespace hord::firmware::store
