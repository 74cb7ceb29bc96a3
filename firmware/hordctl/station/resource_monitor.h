// Records a station's resources over a long run: latencies, memory, descriptors and processor time of each interval.
//
// Memory does not grow with the run: latencies are counted in steps of 10 us.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Latencies of up to two seconds in steps of 10 us; longer ones count as the longest, whose value is kept.
class LatencyCounts {
  public:
    void add(std::uint32_t us);
    void clear();
    [[nodiscard]] std::uint64_t count() const { return count_; }
    // Nearest rank, rounded up to the step; 0 when nothing was counted. `share` in (0, 1].
    [[nodiscard]] double percentile_ms(double share) const;
    [[nodiscard]] double max_ms() const { return static_cast<double>(max_us_) / 1e3; }

  private:
    static constexpr std::uint32_t kStepUs = 10, kSteps = 200'000;
    std::vector<std::uint32_t> steps_ = std::vector<std::uint32_t>(kSteps + 1);
    std::uint64_t count_ = 0;
    std::uint32_t max_us_ = 0;
};

class ResourceMonitor {
  public:
    struct Sample {
        double at_s = 0;                               // since the first part
        std::uint64_t parts = 0, late = 0, unfit = 0;  // in this interval; late: no verdict by the deadline
        double p50_ms = 0, p99_ms = 0, max_ms = 0;     // part sensor to verdict
        std::uint64_t memory_kb = 0;                   // resident
        std::uint64_t descriptors = 0, threads = 0;
        double processor = 0;  // share of one core
    };

    void add(const PartResult& result);
    void sample(double at_s);  // ends an interval

    // A summary: at most ten intervals, and the change of memory, descriptors and latency from the first to the last.
    [[nodiscard]] std::string text() const;
    // All of them, as CSV. Fails with io.
    Result<void> write(const std::string& file) const;

  private:
    LatencyCounts latencies_;
    Sample now_;
    double processor_s_ = 0;
    std::vector<Sample> samples_;
};

}  // namespace hord::firmware
