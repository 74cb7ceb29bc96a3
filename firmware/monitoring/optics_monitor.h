// Watches light and optics while the station works: fed with every inspected part, from any thread; says when the LED
// fades, the dark level drifts, the field is lit unevenly, or dust lies on the optics. Alarms only: no verdict depends
// on it.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "algo/ageing/dust.h"
#include "algo/ageing/light_trend.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// From where on it is a fault. What was reported is over when it is back by a quarter of the way (light, unevenness,
// dark level), or when a window of parts shows no dust.
struct OpticsLimits {
    int window_parts = 100;
    double least_light = 0.8;  // of what parts had
    double most_dark_drift_dn = 1;
    double most_uneven = 0.2;
};

class OpticsMonitor {
  public:
    struct View {
        std::optional<algo::LightAge> light;  // none: too few parts yet
        std::optional<algo::DustFound> dust;
        std::uint32_t faults = 0;  // of kOpticsFaults
        algo::Extents extents;
        float lenslet_mm = 0;  // 0: not known
        int window_parts = 0;
    };

    // Of macro-pixel frames. Fails with invalid_argument as algo/ageing/light_trend.h and algo/ageing/dust.h do.
    static Result<std::unique_ptr<OpticsMonitor>> create(const algo::Extents& extents, const OpticsLimits& limits);

    // Any thread. True when this part changed what is a fault, or where the largest speck is.
    bool add(const FrameView& frame, const algo::Inspection& inspection);

    // Any thread: another recipe judges from now on. What was known of parts is forgotten, and no fault is present.
    void restart(float lenslet_mm);

    [[nodiscard]] View view() const;  // any thread

    // Any thread. Of kOpticsFaults those that came since the last call, and are still there; of dust also when the
    // largest speck lies somewhere else.
    std::uint32_t news();

  private:
    OpticsMonitor(algo::LightTrend light, algo::DustEstimator dust, const algo::Extents& extents,
                  const OpticsLimits& limits);
    void judge_light();

    const OpticsLimits limits_;
    mutable std::mutex mutex_;  // guards the rest
    algo::LightTrend light_;
    algo::DustEstimator dust_;
    View view_;
    std::uint32_t news_ = 0;
};

// One of kOpticsFaults as it is now, with figures and places, and its cure.
Error describe(FaultBit fault, const OpticsMonitor::View& view);

}  // namespace hord::firmware
