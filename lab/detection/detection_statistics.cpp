#include "lab/detection/detection_statistics.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/scene/noise.h"

namespace hord::lab {
namespace {

constexpr int kRepeats = 1000;  // of a bootstrap

// Percentile bootstrap over parts, of a statistic of two samples.
template <class Statistic>
Estimate bootstrap(const Parts& a, const Parts& b, std::uint64_t seed, const Statistic& statistic) {
    Estimate estimate{statistic(a, b), 0, 0};
    std::vector<double> drawn;
    Parts x, y;
    for (int k = 0; k < kRepeats; ++k) {
        sim::Noise draw(seed, static_cast<std::uint64_t>(k), 0xB007);
        const auto again = [&](const Parts& from, Parts& to) {
            to.clear();
            for (std::size_t n = 0; n < from.size(); ++n)
                to.push_back(from[static_cast<std::size_t>(draw.uniform() * static_cast<double>(from.size()))]);
        };
        again(a, x), again(b, y);
        drawn.push_back(statistic(x, y));
    }
    estimate.low = quantile(drawn, 0.025), estimate.high = quantile(drawn, 0.975);
    return estimate;
}

}  // namespace

// A string_view: with a const std::string& GCC 14 warns that the result may dangle.
const Parts& parts_of(const DetectionResults& results, std::string_view figure) {
    static const Parts kNone;
    const auto found = results.parts.find(std::string(figure));
    return found == results.parts.end() ? kNone : found->second;
}
bool is_finished(const DetectionResults& results, const std::string& figure) {
    const auto planned = results.wanted.find(figure);
    return planned != results.wanted.end() && parts_of(results, figure).size() >= planned->second;
}

double share_above(const Parts& parts, double limit) {
    return parts.empty()
        ? 0
        : static_cast<double>(std::ranges::count_if(parts, [&](const JudgedPart& p) { return p.score >= limit; })) /
            static_cast<double>(parts.size());
}

Estimate share_of(double k, double n) {
    const double z = 1.96, p = k / n, middle = (p + z * z / (2 * n)) / (1 + z * z / n),
                 half = z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n);
    return {p, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

Estimate ratio_of_rejects(const Parts& from, const Parts& of, std::uint64_t seed) {
    return bootstrap(from, of, seed, [](const Parts& a, const Parts& b) {
        std::vector<double> scores;
        for (const JudgedPart& p : a) scores.push_back(p.score);
        const double limit = quantile(scores, 0.95);
        return share_above(b, limit) / std::max(share_above(a, limit), 1e-9);
    });
}

Detection roc_of(const Parts& good, const Parts& bad, int good_poses, int bad_poses, std::uint64_t seed) {
    std::vector<ScoredPlace> scored;
    const auto add = [&](const Parts& parts, int poses, bool is_bad) {
        for (std::size_t k = 0; k < parts.size(); ++k) {
            const std::size_t pose = poses > 0 ? k % static_cast<std::size_t>(poses) : k;
            scored.push_back(
                {static_cast<float>(parts[k].score), static_cast<std::uint32_t>(2 * pose + (is_bad ? 1 : 0)), is_bad});
        }
    };
    add(good, good_poses, false), add(bad, bad_poses, true);
    return detection_of(scored, 1e-3, 200, seed);
}

ContrastClaim contrast_claim(const std::vector<PlaceContrast>& places) {
    ContrastClaim claim;
    if (places.empty()) return claim;
    std::vector<double> of_surest, over_emd, surest_over_emd;
    for (const PlaceContrast& p : places) {
        const double emd = std::max(p.emd, 1.0);
        of_surest.push_back(p.score / std::max(p.surest, 1.0));
        over_emd.push_back(p.score / emd);
        surest_over_emd.push_back(p.surest / emd);
        if (of_surest.back() < kOfSurest) claim.below_surest.push_back(p);
        if (surest_over_emd.back() < kOverEmd) ++claim.beyond_reach;
        else if (over_emd.back() < kOverEmd) claim.below_emd.push_back(p);
    }
    const auto spread = [](const std::vector<double>& values) {
        return ContrastClaim::Spread{quantile(values, 0), quantile(values, 0.5), quantile(values, 1)};
    };
    claim.of_surest = spread(of_surest);
    claim.over_emd = spread(over_emd);
    claim.least_surest_over_emd = quantile(surest_over_emd, 0);
    return claim;
}

PodCurve pod_of(const Parts& bubbles, int exposures, double from_rim) {
    std::vector<DetectionTrial> tried;
    for (std::size_t k = 0; k < bubbles.size(); k += static_cast<std::size_t>(exposures)) {
        const JudgedPart& p = bubbles[k];
        if (p.from_rim >= from_rim) tried.push_back({p.size, p.score >= 1 && p.hit});
    }
    return pod_curve(tried);
}

}  // namespace hord::lab
