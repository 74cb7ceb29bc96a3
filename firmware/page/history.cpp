#include "firmware/page/history.h"

#include <algorithm>

#include <fmt/format.h>

namespace hord::firmware::page {

void History::add(std::int64_t time_s, const HistoryValues& values) {
    short_.push_back({time_s, values});
    if (short_.size() > kShortKept) short_.pop_front();
    for (std::size_t k = 0; k < values.size(); ++k) {
        if (!values[k]) continue;
        worst_[k] = count_[k] == 0 ? double{*values[k]} : std::max(worst_[k], double{*values[k]});
        sum_[k] += *values[k];
        ++count_[k];
    }
    if (++in_step_ == kLongStep_s / kShortStep_s) end_long_step(time_s);
}

void History::end_long_step(std::int64_t time_s) {
    Row row{time_s, {}};
    for (std::size_t k = 0; k < kHistoryFields.size(); ++k) {
        const bool latency = kHistoryFields[k].find("p99") != std::string_view::npos;
        if (count_[k] > 0) row.values[k] = static_cast<float>(latency ? worst_[k] : sum_[k] / count_[k]);
    }
    long_.push_back(row);
    if (long_.size() > kLongKept) long_.pop_front();
    sum_ = {};
    worst_ = {};
    count_ = {};
    in_step_ = 0;
}

// Formatted by hand: nlohmann-json cannot write five digits (.5g), which keep a day's charts small.
std::string History::json(bool long_steps) const {
    std::string out = fmt::format("{{\"step_s\":{},\"fields\":[", long_steps ? kLongStep_s : kShortStep_s);
    for (std::size_t k = 0; k < kHistoryFields.size(); ++k)
        out += fmt::format("{}\"{}\"", k > 0 ? "," : "", kHistoryFields[k]);
    out += "],\"rows\":[";
    const char* comma = "";
    for (const Row& row : long_steps ? long_ : short_) {
        out += fmt::format("{}[{}", comma, row.time_s);
        for (const auto& value : row.values) out += value ? fmt::format(",{:.5g}", *value) : std::string(",null");
        out += "]";
        comma = ",";
    }
    return out + "]}";
}

}  // namespace hord::firmware::page
