#include "algo/inspection/defects.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr double kScratchLength = 8;  // lenslets
constexpr double kScratchRatio = 4;

// Value over limit, of each feature.
struct Severity {
    float neighbours = 0, slope = 0, absorption = 0;
    [[nodiscard]] float others() const { return std::max(slope, absorption); }
    [[nodiscard]] float worst() const { return std::max(neighbours, others()); }
};

// Sums and maxima over the flagged lenslets of a region.
struct Region {
    std::uint32_t area = 0;
    double m = 0, n = 0, mm = 0, nn = 0, mn = 0;  // sums of positions and of their products
    Severity severity;
    Severity peak;  // in the features' own units
};

Reason reason_of(const Severity& s) {
    if (s.absorption >= s.neighbours && s.absorption >= s.slope) return Reason::absorption;
    return s.slope >= s.neighbours ? Reason::deflection_gradient : Reason::neighbours_disagree;
}

// Length and width of a uniform bar with the region's second moments, lenslets.
std::pair<double, double> length_and_width(const Region& r) {
    const double mean_m = r.m / r.area, mean_n = r.n / r.area;
    const double mm = r.mm / r.area - mean_m * mean_m, nn = r.nn / r.area - mean_n * mean_n,
                 mn = r.mn / r.area - mean_m * mean_n;
    const double middle = (mm + nn) / 2, spread = std::hypot((mm - nn) / 2, mn);
    const auto side = [](double variance) {
        return std::sqrt(12 * std::max(variance, 0.0) + 1);
    };  // + 1: a lenslet has a width
    return {side(middle + spread), side(middle - spread)};
}

DefectKind kind_of(const Region& r) {
    const auto [length, width] = length_and_width(r);
    if (length >= kScratchLength && length >= kScratchRatio * width) return DefectKind::scratch;
    const bool steep = r.severity.slope >= 1, disagrees = r.severity.neighbours >= 1;
    if (r.severity.absorption >= 1) return steep || disagrees ? DefectKind::unknown : DefectKind::absorbing;
    return steep ? DefectKind::surface : DefectKind::scattering;
}

}  // namespace

float slope_beyond(const OwnSlope& own, float frobenius) {
    return own.bins > 0 ? std::sqrt(std::max(0.0F, frobenius * frobenius + own.squared)) : frobenius;
}

struct DefectFinder::Workspace {
    Workspace(const Extents& e, const Recipe& recipe)
        : extents(e), gradient_limit(limit_of_gradient(recipe)),
          slopes_in_gradient(gradient_is_in_bins(recipe) ? 2.0F : 0.0F), frobenius_limit(recipe.frobenius_limit_bins),
          transmission_limit(recipe.light ? recipe.transmission_limit : 0), min_area(recipe.min_area),
          flagged(e.n, e.m) {}

    Extents extents;
    float gradient_limit, slopes_in_gradient, frobenius_limit, transmission_limit;
    std::uint32_t min_area;
    cv::Mat1b flagged, joined;
    cv::Mat1i labels;
    std::vector<Region> regions;
    std::vector<std::pair<Defect, Severity>> found;
    std::vector<Defect> defects;

    [[nodiscard]] Severity severity(const Features& f, std::size_t k) const {
        if ((f.mask[k] & kNotJudged) != 0) return {};
        Severity s;
        if ((f.mask[k] & kNoGradient) == 0) {
            const OwnSlope own = f.own_slopes.empty() ? OwnSlope{} : f.own_slopes[k];
            if (!f.gradient.empty())
                s.neighbours = std::max(0.0F, f.gradient[k] - slopes_in_gradient * own.bins) / gradient_limit;
            if (!f.frobenius.empty()) s.slope = slope_beyond(own, f.frobenius[k]) / frobenius_limit;
        }
        if ((f.mask[k] & kSaturated) == 0 && transmission_limit > 0) {
            s.absorption = std::max(0.0F, (1 - f.transmission[k]) / (1 - transmission_limit));
        }
        return s;
    }
    void sum_regions(const Features& features);
};

DefectFinder::DefectFinder(const Extents& extents, const Recipe& recipe)
    : workspace_(common::make_opaque<Workspace>(extents, recipe)) {
    // Else OpenCV starts a thread pool, which inherits signal mask and scheduling policy of the first caller.
    static const bool single_threaded = (cv::setNumThreads(1), true);
    static_cast<void>(single_threaded);
}

Result<FoundDefects> DefectFinder::find(const Features& features) {
    Workspace& w = *workspace_;
    w.defects.clear();
    float below = 0;  // the largest severity below 1
    bool any = false;
    for (std::size_t k = 0; k < features.mask.size(); ++k) {
        const Severity s = w.severity(features, k);
        const float worst = s.worst();
        w.flagged.data[k] = worst >= 1 ? 255 : 0;
        if (worst >= 1) any = true;
        else below = std::max(below, !features.bounds.empty() && features.bounds[k] != 0 ? s.others() : worst);
    }
    if (!any) return FoundDefects{{}, Reason::none, below};
    try {
        cv::dilate(w.flagged, w.joined, cv::Mat());  // 3x3
        const int labels = cv::connectedComponents(w.joined, w.labels, 8, CV_32S);
        w.regions.assign(static_cast<std::size_t>(labels), Region{});
    } catch (const cv::Exception& e) {
        return fail(ErrorCode::internal, "the search for defects", e.what());
    }
    w.sum_regions(features);
    w.found.clear();
    for (const Region& r : w.regions) {
        if (r.area < std::max(w.min_area, 1U)) continue;
        const Reason reason = reason_of(r.severity);
        const float peak = reason == Reason::absorption ? r.peak.absorption
            : reason == Reason::deflection_gradient     ? r.peak.slope
                                                        : r.peak.neighbours;
        const auto [length, width] = length_and_width(r);
        w.found.push_back({{.m = static_cast<float>(r.m / r.area),
                            .n = static_cast<float>(r.n / r.area),
                            .area = r.area,
                            .peak = peak,
                            .kind = kind_of(r),
                            .length = static_cast<float>(length),
                            .width = static_cast<float>(width)},
                           r.severity});
    }
    if (w.found.empty()) return FoundDefects{{}, Reason::none, below};
    std::ranges::sort(w.found, [](const auto& a, const auto& b) {
        const float worst_a = a.second.worst(), worst_b = b.second.worst();
        if (worst_a != worst_b) return worst_a > worst_b;
        return std::pair(a.first.n, a.first.m) < std::pair(b.first.n, b.first.m);
    });
    for (const auto& [defect, severity] : w.found) w.defects.push_back(defect);
    return FoundDefects{w.defects, reason_of(w.found.front().second), w.found.front().second.worst()};
}

DefectFinder::Severities DefectFinder::severities(const Features& features, std::size_t k) const {
    const Severity s = workspace_->severity(features, k);
    return {s.neighbours, s.others()};
}

// Adds every flagged lenslet to its region.
void DefectFinder::Workspace::sum_regions(const Features& features) {
    std::size_t k = 0;
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m, ++k) {
            if (flagged.data[k] == 0) continue;
            const Severity s = severity(features, k);
            Region& r = regions[static_cast<std::size_t>(labels(n, m))];
            ++r.area;
            r.m += m;
            r.n += n;
            r.mm += static_cast<double>(m) * m;
            r.nn += static_cast<double>(n) * n;
            r.mn += static_cast<double>(m) * n;
            r.severity = {std::max(r.severity.neighbours, s.neighbours), std::max(r.severity.slope, s.slope),
                          std::max(r.severity.absorption, s.absorption)};
            r.peak = {std::max(r.peak.neighbours, features.gradient.empty() ? 0 : features.gradient[k]),
                      std::max(r.peak.slope, features.frobenius.empty() ? 0 : features.frobenius[k]),
                      std::max(r.peak.absorption, s.absorption * (1 - transmission_limit))};
        }
    }
}

}  // namespace hord::algo
