// The page's data of the station: now and recently. Any thread; memory is bounded.
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
#include "firmware/core/commands.h"
#include "firmware/page/history.h"
#include "firmware/page/viewers.h"
#include "firmware/registers/register_snapshot.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {

// One result of the register ring, for the page.
struct RingResult {
    std::uint32_t boot = 0, sequence = 0, part = 0, defects = 0;
    std::string verdict, reason, reject;
    std::optional<double> score;
    bool bounded = false;  // the score may be an upper bound
    std::optional<double> latency_us, reject_latency_us;
    std::int64_t verdict_ms = 0;            // UTC; time of reading if the page runs on another machine
    [[nodiscard]] std::string key() const;  // "0a1b2c3d-42", as in the page's addresses
    [[nodiscard]] store::Json json() const;
};

// A histogram of seconds with Prometheus's buckets.
class LatencyHistogram {
  public:
    static constexpr std::array<double, 12> kBounds_s{0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.75, 1, 2};
    void add(double seconds);
    std::array<std::uint64_t, kBounds_s.size() + 1> counts{};  // in each step, the last one beyond all bounds
    double sum_s = 0;
};

class Live {
  public:
    static constexpr std::size_t kStrip = 120;  // results shown when a page is opened

    explicit Live(Viewers& viewers) : viewers_(viewers) {}

    // From the polling thread.
    void set_station(const RegisterSnapshot& snapshot);
    void add_result(const RingResult& result);
    void add_missed(std::uint32_t results);    // overwritten in the ring before they were read
    void set_unreachable(const Error& error);  // the station does not answer
    // The frame of a rejected part is in the archive. Comes before the part's result.
    void set_picture(std::uint32_t boot, std::uint32_t part, std::int64_t verdict_ms);
    void set_light(double share);     // brightest_share() of a kept frame
    void sample(std::int64_t now_s);  // a row of the charts, once every History::kShortStep_s

    // The data of a page that opens: state, and the newest results, oldest first.
    [[nodiscard]] store::Json page_json() const;
    // The state alone: the event that is sent every second and at each change.
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
    Figures now_;
    Error trouble_{ErrorCode::disconnected, "waiting for the station's first data", ""};
    std::deque<RingResult> strip_;
    store::Json picture_;  // of the newest reject; null: none
    History history_;
    struct Counted {
        std::uint32_t boot = 0;
        double pass = 0, reject = 0, unfit = 0;
    };
    std::optional<Counted> counted_;  // at the last sample
};

}  // namespace hord::firmware::page
