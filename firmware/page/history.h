// Figures over time for the page's charts, in two rings of fixed size: a quarter of an hour in steps of two seconds,
// and a day in steps of four minutes. Not thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

namespace hord::firmware::page {

// Fields of a sample, in this order. A long step holds the mean of its samples; for the p99 latencies the maximum.
constexpr std::array<std::string_view, 12> kHistoryFields{"parts_per_minute", "pass_per_minute",   "reject_per_minute",
                                                          "unfit_per_minute", "latency_p50_ms",    "latency_p99_ms",
                                                          "reject_p99_ms",    "drift_px",          "residual_px",
                                                          "light_percent",    "processor_celsius", "disk_free_percent"};
using HistoryValues = std::array<std::optional<float>, kHistoryFields.size()>;

class History {
  public:
    static constexpr int kShortStep_s = 2, kLongStep_s = 240;
    static constexpr std::size_t kShortKept = 450, kLongKept = 360;

    // Call every kShortStep_s; values are empty while the station does not answer.
    void add(std::int64_t time_s, const HistoryValues& values);

    // {"step_s":2,"fields":[...],"rows":[[time_s,value or null,...],...]}, oldest first.
    [[nodiscard]] std::string json(bool long_steps) const;
    [[nodiscard]] std::size_t size(bool long_steps) const { return long_steps ? long_.size() : short_.size(); }

  private:
    struct Row {
        std::int64_t time_s = 0;
        HistoryValues values;
    };
    void end_long_step(std::int64_t time_s);
    std::deque<Row> short_, long_;
    std::array<double, kHistoryFields.size()> sum_{}, worst_{};
    std::array<int, kHistoryFields.size()> count_{};
    int in_step_ = 0;
};

}  // namespace hord::firmware::page
