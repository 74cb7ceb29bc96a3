#include "firmware/store/results/clock_days.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <utility>

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
    return to_text(
        {{"day", day.day}, {"date", format_day(day.day)}, {"results", day.results}, {"commands", day.commands}});
}

std::optional<ClockDay> clock_day_from(const std::string& json) {
    const Json read = parse_stored(json);
    ClockDay day;
    for (auto [name, value] :
         {std::pair("day", &day.day), std::pair("results", &day.results), std::pair("commands", &day.commands)}) {
        const auto found = integer_in(read, name);
        if (!found) return std::nullopt;
        *value = *found;
    }
    const bool possible = day.day >= 0 && day.day <= kLastDay && day.results >= 0 && day.commands >= 0;
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
    const bool apart = !entered_at_us_ || now.steady_us - *entered_at_us_ >= kApartUs;
    return apart && shown_us_ >= kWitnessUs ? std::optional(day) : std::nullopt;
}

void ClockDays::add(const ClockDay& entry) {
    // Numbers only grow: an older entry with a higher one is damaged.
    for (auto day = entries_.rbegin(); day != entries_.rend(); ++day) {
        if (day->results <= entry.results && day->commands <= entry.commands) break;
        day->results = std::min(day->results, entry.results);
        day->commands = std::min(day->commands, entry.commands);
    }
    entries_.push_back(entry);
    const auto place = std::lower_bound(calendar_.begin(), calendar_.end(), entry.day);
    if (place != calendar_.end() && *place == entry.day) return;
    calendar_.insert(place, entry.day);
    positions_.assign(calendar_.size(), 0);
    for (std::size_t k = 1; k < calendar_.size(); ++k) {
        const std::int64_t gap = calendar_[k] - calendar_[k - 1];
        positions_[k] = positions_[k - 1] + (gap <= kLongestGap ? gap : 0);
    }
}

std::optional<std::int64_t> ClockDays::newest() const {
    return entries_.empty() ? std::nullopt : std::optional(entries_.back().day);
}

std::int64_t ClockDays::position(std::int64_t day) const {
    const auto place = std::lower_bound(calendar_.begin(), calendar_.end(), day);
    return positions_[static_cast<std::size_t>(place - calendar_.begin())];
}

std::optional<ClockDays::Older> ClockDays::older_than(std::int64_t keep_days) const {
    if (entries_.size() < kHeld) return std::nullopt;
    // Today: the earliest of the last days.
    std::int64_t today = entries_.back().day;
    for (auto entry = entries_.end() - kHeld; entry != entries_.end(); ++entry) today = std::min(today, entry->day);
    const std::int64_t now = position(today);
    // The rows of an entry are dated by the median of the `kHeld` entries from it on, and never earlier than those
    // before them: a clock that was behind makes nothing older.
    std::optional<Older> older;
    std::int64_t latest = 0;
    for (std::size_t k = 0; k + kHeld <= entries_.size(); ++k) {
        std::array<std::int64_t, kHeld> held{};
        std::transform(entries_.begin() + static_cast<std::ptrdiff_t>(k),
                       entries_.begin() + static_cast<std::ptrdiff_t>(k + kHeld), held.begin(),
                       [](const ClockDay& entry) { return entry.day; });
        std::nth_element(held.begin(), held.begin() + kHeld / 2, held.end());
        latest = std::max(latest, held[kHeld / 2]);
        const std::int64_t age = now - position(latest);
        if (latest > today || age < keep_days) break;
        older = Older{entries_[k], age};
    }
    return older;
}

}  // namespace hord::firmware::store
