#include "firmware/monitoring/optics_monitor.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "firmware/core/faults.h"

namespace hord::firmware {
namespace {

constexpr double kWayBack = 0.25;  // hysteresis, share of the limit
constexpr float kSamePlace = 2;    // lenslets: a largest speck farther away is another one

bool beyond(bool before, double value, double limit) { return value > (before ? (1 - kWayBack) * limit : limit); }

std::string place_of(const OpticsMonitor::View& view, const algo::Speck& speck) {
    std::string text = fmt::format("lenslet ({:.0f}, {:.0f})", speck.m, speck.n);
    if (view.lenslet_mm > 0) {
        const float x = (speck.m - 0.5F * static_cast<float>(view.extents.m - 1)) * view.lenslet_mm,
                    y = (speck.n - 0.5F * static_cast<float>(view.extents.n - 1)) * view.lenslet_mm;
        text += fmt::format(", at ({:.2f}, {:.2f}) mm from the field's middle", x, y);
    }
    return text;
}

std::string describe_dust(const OpticsMonitor::View& view) {
    if (!view.dust || view.dust->specks == 0) return "no dust is on the optics";
    const algo::Speck& largest = view.dust->largest[0];
    std::string text =
        fmt::format("the same place responds in {:.0f} % of the last {} parts: {}, {} lenslet{}", 100 * largest.share,
                    view.window_parts, place_of(view, largest), largest.lenslets, largest.lenslets == 1 ? "" : "s");
    if (view.dust->specks > 1) text += fmt::format(", and {} more", view.dust->specks - 1);
    // A pixel changes the gradients of the lenslets around its own.
    const char* const pixel =
        largest.lenslets <= 9 ? "; a warm pixel of the sensor does the same: have the camera correct it" : "";
    if (largest.tells_apart) return text + "; the parts moved and it did not: dust on the optics" + pixel;
    return text + "; dust on the optics, or the same flaw in every part" + pixel;
}

std::string describe_light(FaultBit fault, const OpticsMonitor::View& view) {
    if (!view.light) return "nothing is known of the light yet";
    const algo::LightAge& age = *view.light;
    if (fault == kFaultLightFading)
        return fmt::format("parts have {:.0f} % of the light that {} had", 100 * age.light,
                           age.since_reference ? "the reference's parts" : "the first parts");
    if (fault == kFaultDarkDrift)
        return fmt::format("the dark level has changed by {:+.2f} DN since the first parts, to {:.2f} DN",
                           age.dark_drift_dn, age.dark_dn);
    return fmt::format("the light around lenslet ({:.0f}, {:.0f}) has changed by {:+.0f} % against the whole field",
                       age.uneven_m, age.uneven_n, 100 * age.uneven);
}

}  // namespace

OpticsMonitor::OpticsMonitor(algo::LightTrend light, algo::DustEstimator dust, const algo::Extents& extents,
                             const OpticsConfig& limits)
    : limits_(limits), light_(std::move(light)), dust_(std::move(dust)) {
    view_.extents = extents;
    view_.window_parts = limits.window_parts;
}

Result<std::unique_ptr<OpticsMonitor>> OpticsMonitor::create(const algo::Extents& extents, const OpticsConfig& limits) {
    auto light = algo::LightTrend::create(extents, limits.window_parts);
    if (!light) return tl::unexpected(light.error());
    auto dust = algo::DustEstimator::create(extents, limits.window_parts);
    if (!dust) return tl::unexpected(dust.error());
    return std::unique_ptr<OpticsMonitor>(new OpticsMonitor(std::move(*light), std::move(*dust), extents, limits));
}

void OpticsMonitor::judge_light() {
    const algo::LightAge& age = *view_.light;
    const auto is = [&](FaultBit fault, double value, double limit) {
        const bool now = beyond((view_.faults & fault) != 0, value, limit);
        view_.faults = now ? view_.faults | fault : view_.faults & ~std::uint32_t{fault};
    };
    is(kFaultLightFading, 1 - age.light, 1 - limits_.least_light);
    is(kFaultDarkDrift, std::abs(age.dark_drift_dn), limits_.most_dark_drift_dn);
    is(kFaultLightUneven, std::abs(age.uneven), limits_.most_uneven);
}

bool OpticsMonitor::add(const FrameView& frame, const algo::Inspection& inspection) {
    const std::lock_guard lock(mutex_);
    const std::uint32_t before = view_.faults;
    bool moved = false;
    if (light_.add(frame, inspection)) {
        view_.light = light_.latest();
        judge_light();
    }
    if (dust_.add(inspection)) {
        const auto was = view_.dust;
        view_.dust = dust_.latest();
        const bool dusty = view_.dust->specks > 0;
        view_.faults = dusty ? view_.faults | kFaultDust : view_.faults & ~std::uint32_t{kFaultDust};
        const algo::Speck &old = was ? was->largest[0] : algo::Speck{}, &now = view_.dust->largest[0];
        moved = dusty && was && was->specks > 0 && std::hypot(now.m - old.m, now.n - old.n) > kSamePlace;
    }
    news_ |= (view_.faults & ~before) | (moved ? std::uint32_t{kFaultDust} : 0U);
    return moved || view_.faults != before;
}

void OpticsMonitor::restart(float lenslet_mm) {
    const std::lock_guard lock(mutex_);
    light_.restart();
    dust_.restart();
    view_.light.reset();
    view_.dust.reset();
    view_.faults = 0;
    view_.lenslet_mm = lenslet_mm;
}

std::uint32_t OpticsMonitor::news() {
    const std::lock_guard lock(mutex_);
    return std::exchange(news_, 0) & view_.faults;
}

OpticsMonitor::View OpticsMonitor::view() const {
    const std::lock_guard lock(mutex_);
    return view_;
}

OpticsConfig limits_of(OpticsConfig config, int bits) {
    if (config.most_dark_drift_dn == 0) config.most_dark_drift_dn = static_cast<double>(1U << (bits - 8));
    return config;
}

OpticsReport report_of(const OpticsMonitor::View& view) {
    const auto lenslet = [](float place) {
        return static_cast<std::uint16_t>(std::clamp(std::lround(place), 0L, 0xFFFEL));
    };
    OpticsReport report;
    if (const auto& age = view.light) {
        report.light_percent = 100 * age->light;
        report.dark_drift_dn = age->dark_drift_dn;
        report.uneven_percent = 100 * age->uneven;
        report.uneven_m = lenslet(age->uneven_m);
        report.uneven_n = lenslet(age->uneven_n);
    }
    if (view.dust) report.specks = view.dust->specks;
    if (!view.dust || view.dust->specks == 0) return report;
    const algo::Speck& largest = view.dust->largest[0];
    report.dust_m = lenslet(largest.m);
    report.dust_n = lenslet(largest.n);
    report.dust_lenslets = largest.lenslets;
    report.dust_share_percent = 100 * static_cast<double>(largest.share);
    if (view.lenslet_mm > 0) {
        report.dust_x_mm =
            (static_cast<double>(largest.m) - 0.5 * (view.extents.m - 1)) * static_cast<double>(view.lenslet_mm);
        report.dust_y_mm =
            (static_cast<double>(largest.n) - 0.5 * (view.extents.n - 1)) * static_cast<double>(view.lenslet_mm);
    }
    return report;
}

Error describe(FaultBit fault, const OpticsMonitor::View& view) {
    return {ErrorCode::invalid_argument, fault == kFaultDust ? describe_dust(view) : describe_light(fault, view),
            std::string(info_of(fault).cure)};
}

}  // namespace hord::firmware
