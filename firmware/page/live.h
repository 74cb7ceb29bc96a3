// What the page knows of the station now and of the last while. Any thread; memory does not grow.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/page/history.h"
#include "firmware/page/viewers.h"
#include "firmware/registers/register_snapshot.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {

// One of the ring's results, as people are told of it.
struct RingResult {
    std::uint32_t boot = 0, sequence = 0, part = 0, defects = 0;
    std::string verdict, reason, reject;
    std::optional<double> score;
    std::optional<double> latency_us, reject_latency_us;
    std::int64_t verdict_ms = 0;  // UTC; when the page runs on another machine than the station: when the page saw it
    [[nodiscard]] std::string key() const;  // "0a1b2c3d-42", as in the page's addresses
    [[nodiscard]] store::Json json() const;
};

// Seconds, as Prometheus counts: how many were at most so long.
class LatencyHistogram {
  public:
    static constexpr std::array<double, 12> kBounds_s{0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.75, 1, 2};
    void add(double seconds);
    std::array<std::uint64_t, kBounds_s.size() + 1> counts{};  // in each step, the last one beyond all bounds
    double sum_s = 0;
};

class Live {
  public:
    static constexpr std::size_t kStrip = 120;  // results that a page begins with

    explicit Live(Viewers& viewers) : viewers_(viewers) {}

    // The station's answers, from the thread that asks.
    void set_station(const RegisterSnapshot& snapshot);
    void add_result(const RingResult& result);
    void add_missed(std::uint32_t results);    // the ring had gone round
    void set_unreachable(const Error& error);  // nobody answers
    // The frame of a part that did not pass is kept and can be drawn. It comes before the result, which is whole when
    // the part is past the ejector.
    void set_picture(std::uint32_t boot, std::uint32_t part, std::int64_t verdict_ms);
    void set_light(double share);     // of a kept frame's brightest samples, 1: full scale
    void sample(std::int64_t now_s);  // a row of the charts, once every History::kShortStep_s

    // Everything that a page begins with: state, and the newest results, oldest first.
    [[nodiscard]] store::Json page_json() const;
    // State alone: what viewers are told every second and whenever it changes.
    [[nodiscard]] store::Json state_json() const;
    [[nodiscard]] std::string history_json(bool long_steps) const;

    struct Figures {
        bool up = false;
        RegisterSnapshot snapshot;
        LatencyHistogram verdict, reject;
        std::map<std::string, std::uint64_t> by_reason;
        std::uint64_t missed = 0;
        std::optional<double> light;
    };
    [[nodiscard]] Figures figures() const;

  private:
    [[nodiscard]] store::Json state_locked() const;

    Viewers& viewers_;
    mutable std::mutex mutex_;
    bool up_ = false;
    Error trouble_{ErrorCode::disconnected, "the station was not asked yet", ""};
    RegisterSnapshot snapshot_;
    std::deque<RingResult> strip_;
    LatencyHistogram verdict_, reject_;
    std::map<std::string, std::uint64_t> by_reason_;
    std::uint64_t missed_ = 0;
    store::Json picture_;  // the newest that was kept; null: none
    std::optional<double> light_;
    History history_;
    struct Counted {
        std::uint32_t boot = 0;
        double pass = 0, reject = 0, unfit = 0;
    };
    std::optional<Counted> counted_;  // at the last sample
};

}  // namespace hord::firmware::page
