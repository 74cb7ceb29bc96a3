// The texts of `hordctl latency`: one measured series, and the machine.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "firmware/core/core_config.h"

namespace hord::firmware {

struct Series {
    std::string what;  // the measured quantity
    std::vector<Duration> samples;
    int missed = 0;
    void add(std::optional<Duration> sample);  // empty: missed
};

// Count, p50, p99, p99.9 (from 1000 samples on), maximum and a histogram, in microseconds.
std::string text_of(Series series);

// Processors, kernel, preemption, clock source and speed governor: what the latencies depend on.
std::string machine_text();

}  // namespace hord::firmware
