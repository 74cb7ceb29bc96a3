#include "firmware/monitoring/optics_report.h"

#include <algorithm>
#include <cmath>

namespace hord::firmware {

OpticsLimits limits_of(const OpticsConfig& config, int bits) {
    return {config.window_parts, config.least_light,
            config.most_dark_drift_dn > 0 ? config.most_dark_drift_dn : static_cast<double>(1U << (bits - 8)),
            config.most_uneven};
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

}  // namespace hord::firmware
