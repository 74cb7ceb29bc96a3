// Monitors light and optics at run time, from every inspected part: fading LED, drift of the dark level, uneven light,
// dust. It raises faults only; no verdict depends on it.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "algo/ageing/dust.h"
#include "algo/ageing/light_trend.h"
#include "firmware/config/config.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

class OpticsMonitor {
  public:
    struct View {
        std::optional<algo::LightAge> light;  // empty: too few parts yet
        std::optional<algo::DustFound> dust;
        std::uint32_t faults = 0;  // of kOpticsFaults
        algo::Extents extents;
        float lenslet_mm = 0;  // 0: not known
        int window_parts = 0;
    };

    // For macro-pixel frames. `limits`: as limits_of() returns them. A fault is over below 3/4 of its limit (light,
    // unevenness, dark level), or when a window of parts shows no dust. Fails with invalid_argument as
    // algo/ageing/light_trend.h and algo/ageing/dust.h do.
    static Result<std::unique_ptr<OpticsMonitor>> create(const algo::Extents& extents, const OpticsConfig& limits);

    // Any thread. True when a fault came or went, or the largest speck is another one.
    bool add(const FrameView& frame, const algo::Inspection& inspection);

    // Any thread. Call it when the recipe changes: forgets all parts and faults.
    void restart(float lenslet_mm);

    [[nodiscard]] View view() const;  // any thread

    // Any thread. The kOpticsFaults that came since the last call and are still active; dust also when the largest
    // speck has changed.
    std::uint32_t news();

  private:
    OpticsMonitor(algo::LightTrend light, algo::DustEstimator dust, const algo::Extents& extents,
                  const OpticsConfig& limits);
    void judge_light();

    const OpticsConfig limits_;
    mutable std::mutex mutex_;  // guards the rest
    algo::LightTrend light_;
    algo::DustEstimator dust_;
    View view_;
    std::uint32_t news_ = 0;
};

// The configured limits for frames of so many bits a sample; most_dark_drift_dn above 0.
OpticsConfig limits_of(OpticsConfig config, int bits);

OpticsReport report_of(const OpticsMonitor::View& view);

// Describes one of kOpticsFaults with figures, positions and cure.
Error describe(FaultBit fault, const OpticsMonitor::View& view);

}  // namespace hord::firmware
