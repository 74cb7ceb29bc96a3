// Latency of a simulated device: a base and a uniform spread, drawn from the seed.
#pragma once

#include "drivers/hal/clock.h"
#include "hal_sim/world/random.h"

namespace hord::sim {

struct LatencyOptions {
    hal::Duration base{};
    hal::Duration spread{};  // uniform in [0, spread)
};

class Latency {
  public:
    Latency(const LatencyOptions& options, std::uint64_t seed, std::uint64_t stream)
        : options_(options), seed_(seed), stream_(stream) {}
    hal::Duration next() {
        const double share = random_unit(seed_, stream_, drawn_++);
        return options_.base +
            hal::Duration(static_cast<hal::Duration::rep>(share * static_cast<double>(options_.spread.count())));
    }

  private:
    LatencyOptions options_;
    std::uint64_t seed_, stream_, drawn_ = 0;
};

}  // namespace hord::sim
