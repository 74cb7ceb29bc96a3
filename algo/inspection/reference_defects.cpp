#include "algo/inspection/reference_defects.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "algo/frame/flood.h"
#include "algo/frame/lenslet_scan.h"
#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// Shares of a region's squared scores that decide its kind.
constexpr double kDominantShare = 0.6, kMuchShare = 0.25;
// The EMD gradient by photon noise alone, in bins times the root of the electrons.
constexpr float kEmdOfNoise = 10;

float score(const Scores& s, Deviation which) { return s[static_cast<std::size_t>(which)]; }

// The score of the shape is one-sided: less than expected is no defect.
float worst_of(const Scores& s) {
    return std::max({std::abs(score(s, Deviation::light)), score(s, Deviation::deflection_shift),
                     std::abs(score(s, Deviation::scattering)), score(s, Deviation::shape), 0.0F});
}

// ln(x), x above 0, by operations that IEEE 754 rounds alike on every machine.
double exact_log(double x) {
    int exponent = 0;
    const double mantissa = std::frexp(x, &exponent);  // 0.5 to 1
    const double t = (mantissa - 0.75) / (mantissa + 0.75), t2 = t * t;
    constexpr double kLog2 = 0.6931471805599453, kLogOf075 = -0.2876820724517809;
    double sum = 0;
    for (int k = 21; k >= 1; k -= 2) sum = sum * t2 + 1.0 / k;
    return exponent * kLog2 + kLogOf075 + 2 * t * sum;
}

// The root of the Poisson deviance over the z-score, for a relative change d of the light, -1 (all is missing) to below
// 0: sqrt(2 ((1 + d) ln(1 + d) - d)) / |d|, from 1.41 to 1. Above -0.05 by its series.
float poisson_ratio(float d) {
    const double v = static_cast<double>(d), left = 1 + v;
    if (v > -0.05) return 1 - d / 6;
    return static_cast<float>(std::sqrt(2 * ((left > 1e-9 ? left * exact_log(left) : 0) - v)) / -v);
}

// The worst score of a lenslet. Where missing light is a defect by itself, it is scored by the Poisson deviance, and
// the other scores are scaled up to the noise of the full light.
float z_score_of(const Scores& s, const Difference& d, float reject_score) {
    const float light = score(s, Deviation::light);
    if (light > -reject_score) return worst_of(s);
    const float others = std::max({score(s, Deviation::deflection_shift), std::abs(score(s, Deviation::scattering)),
                                   score(s, Deviation::shape), 0.0F});
    return std::max(-light * poisson_ratio(d.light), others / std::sqrt(std::max(1 + d.light, 0.01F)));
}

// Standard deviations that one of 10,000 frames exceeds by noise in any of so many tests: of the normal distribution,
// whose share beyond z is exp(-z^2 / 2) / (z sqrt(2 pi)) (right to 3 % from 5 on).
float limit_of_tests(double tests) {
    const double share = 1e-4 / tests;
    double z = 5;
    for (int step = 0; step < 8; ++step)
        z = std::sqrt(-2 * exact_log(share * z * std::numbers::sqrt2 / std::numbers::inv_sqrtpi));
    return static_cast<float>(z);
}

double square(float v) { return static_cast<double>(v) * static_cast<double>(v); }

}  // namespace

ReferenceDefects::ReferenceDefects(const Extents& extents, const Recipe& recipe)
    : extents_(extents), recipe_(recipe), reference_(*recipe.reference), sizer_(reference_), patches_(reference_),
      patch_limit_(
          std::max({recipe.reject_score, reference_.patch_limit, limit_of_tests(LightPatches::tests(extents))})),
      scores_(extents.lenslets()), z_severity_(extents.lenslets()), severity_(extents.lenslets()),
      without_emd_(extents.lenslets()), by_gradient_(extents.lenslets()), visited_(extents.lenslets()),
      queue_(extents.lenslets()), used_(recipe.tolerances.size()) {
    found_.reserve(1000);
    allowed_.reserve(1000);
    defects_.reserve(1000);
    if (recipe_.pooled_score > 0 && !reference_.pooled_scales.empty()) pooled_.emplace(extents);
}

void ReferenceDefects::score_lenslets(const ComparedFrame& c, std::span<float> z_score) {
    for (int n = 0; n < extents_.n; ++n) score_row(c, n, z_score);
}

void ReferenceDefects::score_row(const ComparedFrame& c, int n, std::span<float> z_score) {
    for (std::size_t k = extents_.index(0, n); k < extents_.index(0, n + 1); ++k) {
        scores_[k] = {};
        z_severity_[k] = 0;
        z_score[k] = 0;
        severity_[k] = 0;
        without_emd_[k] = 0;
        by_gradient_[k] = 0;
        if ((c.mask[k] & (kOutside | kSaturated)) != 0) continue;
        const Difference& d = c.differences[k];
        if (d.has_light) scores_[k] = scores_of(d, reference_);
        z_score[k] = z_score_of(scores_[k], d, recipe_.reject_score);
        z_severity_[k] = z_score[k] / recipe_.reject_score;
        const float others = without_emd_[k] = severity_without_emd(c, k), of_emd = severity_of_emd(c, k);
        severity_[k] = std::max(others, of_emd);
        if (of_emd > others) {
            by_gradient_[k] = of_emd;
            continue;
        }
        // describe() uses the gradient itself where all squared scores of a region are 0.
        const Scores& s = scores_[k];
        const bool has_squares = score(s, Deviation::light) != 0 || score(s, Deviation::deflection_shift) != 0 ||
            score(s, Deviation::scattering) > 0 || score(s, Deviation::shape) > 0;
        by_gradient_[k] = has_squares || c.emd.empty() || (c.mask[k] & kNoGradient) != 0 ? 0 : others;
    }
}

float ReferenceDefects::severity_now(const ComparedFrame& c, std::size_t k) const {
    return std::max(without_emd_[k], severity_of_emd(c, k));
}

// By the scores and the slope.
float ReferenceDefects::severity_without_emd(const ComparedFrame& c, std::size_t k) const {
    const Difference& d = c.differences[k];
    if ((c.mask[k] & (kNoGradient | kNotJudged)) != 0 || !d.has_light || c.frobenius.empty()) return z_severity_[k];
    return std::max(z_severity_[k], (c.frobenius[k] - reference_.frobenius[d.at]) / recipe_.frobenius_limit_bins);
}

// 0 or what it was without the noise, if it is below the severity by the scores: it does not count then.
float ReferenceDefects::severity_of_emd(const ComparedFrame& c, std::size_t k) const {
    const Difference& d = c.differences[k];
    if ((c.mask[k] & (kNoGradient | kNotJudged)) != 0 || !d.has_light || c.emd.empty()) return 0;
    const float emd = (c.emd[k] - reference_.emd[d.at]) / recipe_.emd_limit_bins;
    if (!(emd > z_severity_[k])) return emd;
    // Less light than the reference's has more noise. This is computed only where it can change the result.
    const float electrons = reference_.sensor.electrons_per_dn, here = std::max(d.sum, 1.0F),
                there = std::max(reference_.light[d.at], 1.0F);
    const float noise =
        kEmdOfNoise * std::max(0.0F, 1 / std::sqrt(here * electrons) - 1 / std::sqrt(there * electrons));
    return (c.emd[k] - reference_.emd[d.at]) / (recipe_.emd_limit_bins + noise);
}

// The share of noise in the variance of the worst score.
float ReferenceDefects::noise_share(const Scores& s, const Difference& d) const {
    const Scores shares = noise_shares(d, reference_);
    std::size_t worst = 0;
    for (std::size_t w = 1; w < kDeviations; ++w) {
        const auto size = [&](std::size_t which) {
            return which == static_cast<std::size_t>(Deviation::shape) ? s[which] : std::abs(s[which]);
        };
        if (size(w) > size(worst)) worst = w;
    }
    return shares[worst];
}

// The connected lenslets at or above grow_score, from `seed` on, that are not visited; valid until the next call.
std::span<const std::uint32_t> ReferenceDefects::take_lenslets(std::uint32_t seed) {
    const float grow = grow_severity();
    const std::size_t count = flood(extents_, seed, 1, Connected::at_corners_too, queue_, [&](std::size_t k) {
        return severity_[k] >= grow && std::exchange(visited_[k], std::uint8_t{1}) == 0;
    });
    return std::span(queue_).first(count);
}

ReferenceDefects::Region ReferenceDefects::grow_region(std::uint32_t seed, const ComparedFrame& c) {
    Region r;
    for (const std::uint32_t k : take_lenslets(seed)) {
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m;
        const Scores& s = scores_[k];
        const float in_noise = severity_[k] * recipe_.reject_score,
                    by_reference = z_score_of(s, c.differences[k], recipe_.reject_score);
        const double weight = std::min(static_cast<double>(severity_[k]), 2.0);
        ++r.area;
        r.weight += weight;
        r.m += weight * m, r.n += weight * n;
        r.mm += weight * m * m, r.nn += weight * n * n, r.mn += weight * m * n;
        const bool by_gradient = in_noise > by_reference * 1.0001F;
        r.squares += square(in_noise) * (by_gradient ? 1 : static_cast<double>(noise_share(s, c.differences[k])));
        (score(s, Deviation::light) < 0 ? r.missing_light : r.added_light) += square(score(s, Deviation::light));
        r.shift += square(score(s, Deviation::deflection_shift));
        r.scattering += square(std::max(0.0F, score(s, Deviation::scattering)));
        r.shape += square(std::max(0.0F, score(s, Deviation::shape)));
        if (by_gradient) r.gradient += square(in_noise);
        r.worst = std::max(r.worst, severity_[k]);
        const Difference& d = c.differences[k];
        r.min_light = std::min(r.min_light, d.light);
        if (d.has_hord) {
            r.max_shift = std::max(r.max_shift, std::sqrt(d.x * d.x + d.y * d.y));
            r.max_scattering = std::max(r.max_scattering, std::sqrt(std::max(0.0F, d.scattering)));
        }
        if (!c.emd.empty() && (c.mask[k] & kNoGradient) == 0) r.max_gradient = std::max(r.max_gradient, c.emd[k]);
    }
    return r;
}

Defect ReferenceDefects::describe(const Region& r, Reason& reason) const {
    Defect d;
    d.m = static_cast<float>(r.m / r.weight);
    d.n = static_cast<float>(r.n / r.weight);
    d.area = r.area;
    d.score = std::max(r.worst, static_cast<float>(std::sqrt(r.squares)) / recipe_.cluster_score);
    const double mean_m = r.m / r.weight, mean_n = r.n / r.weight;
    const double mm = r.mm / r.weight - mean_m * mean_m, nn = r.nn / r.weight - mean_n * mean_n,
                 mn = r.mn / r.weight - mean_m * mean_n;
    const double middle = (mm + nn) / 2, half = std::sqrt((mm - nn) * (mm - nn) / 4 + mn * mn);
    const auto side = [](double variance) { return std::sqrt(12 * std::max(variance, 0.0) + 1); };
    d.length = static_cast<float>(side(middle + half));
    d.width = static_cast<float>(side(middle - half));
    const double all = r.missing_light + r.added_light + r.shift + r.scattering + r.shape;
    const double shift_and_shape = r.shift + r.shape;
    const bool absorbs = r.missing_light >= kDominantShare * all,
               scatters = r.scattering >= kMuchShare * all && r.scattering >= shift_and_shape,
               shifts = shift_and_shape > r.scattering && shift_and_shape + r.scattering >= kDominantShare * all;
    const double length = static_cast<double>(d.length), width = static_cast<double>(d.width);
    if (length >= kScratchLength && length >= kScratchRatio * width) d.kind = DefectKind::scratch;
    else if (all <= 0 || r.gradient > all) d.kind = DefectKind::unknown;
    else
        d.kind = absorbs ? DefectKind::absorbing
            : scatters   ? DefectKind::scattering
            : shifts     ? DefectKind::surface
                         : DefectKind::unknown;
    reason = r.missing_light >= shift_and_shape && r.missing_light >= r.scattering ? Reason::absorption
        : shift_and_shape >= r.scattering                                          ? Reason::deflection_gradient
                                                                                   : Reason::neighbours_disagree;
    if (all <= 0) reason = Reason::neighbours_disagree;
    d.peak = reason == Reason::absorption       ? -r.min_light
        : reason == Reason::deflection_gradient ? r.max_shift
                                                : std::max(r.max_scattering, all <= 0 ? r.max_gradient : 0.0F);
    return d;
}

// Place and size of the worst of found_, by the light. They are told only: no verdict depends on them.
void ReferenceDefects::measure_worst(const ComparedLight& light, const PoseMap& pose) {
    std::ranges::fill(visited_, std::uint8_t{0});
    sizer_.start_frame();
    std::size_t lenslets = 0;
    for (Found& found : std::span(found_).first(std::min(found_.size(), kMaxSized))) {
        if (found.defect.weak || found.defect.area > FlawSizer::kMaxLenslets) continue;
        lenslets += found.defect.area;
        if (lenslets > kMaxSizedLenslets || sizer_.lenslets_read() > extents_.lenslets() / kSizedOf) return;
        const auto size = sizer_.measure(light, pose, take_lenslets(found.seed),
                                         [&](std::size_t k) { return severity_[k] >= grow_severity(); });
        if (!size) continue;
        Defect& d = found.defect;
        const double reach = std::sqrt(static_cast<double>(d.area));
        const auto within = [reach](float middle, double at) {
            return static_cast<float>(
                std::clamp(at, static_cast<double>(middle) - reach, static_cast<double>(middle) + reach));
        };
        d.m = within(d.m, size->m), d.n = within(d.n, size->n);
        const bool scratch = d.kind == DefectKind::scratch;
        d.radius = static_cast<float>(scratch ? std::sqrt(size->area * std::numbers::inv_pi) : size->radius);
        if (!scratch || !(size->length >= kScratchLength)) continue;
        d.length = static_cast<float>(size->length);
        d.width = static_cast<float>(size->area / size->length);
    }
}

Defect ReferenceDefects::describe(const PooledPeak& peak, Reason& reason) const {
    const PooledFilter& filter = pooled_filters()[peak.filter];
    Defect d;
    d.m = peak.m, d.n = peak.n;
    d.area = peak.area;
    d.length = peak.length, d.width = peak.width;
    d.peak = filter.deviation == Deviation::scattering ? std::sqrt(std::max(0.0F, peak.value)) : std::abs(peak.value);
    d.weak = true;
    switch (filter.deviation) {
        case Deviation::light:
            d.kind = filter.is_band() && d.length >= kScratchLength ? DefectKind::scratch : DefectKind::absorbing;
            reason = Reason::absorption;
            break;
        case Deviation::deflection_shift:
            d.kind = DefectKind::surface;
            reason = Reason::deflection_gradient;
            break;
        default: d.kind = DefectKind::scattering, reason = Reason::neighbours_disagree;
    }
    return d;
}

// Takes what lenslets show together as a defect, or as part of a region that lies there; unless a tolerance allows it.
void ReferenceDefects::add_weak(Defect defect, Reason reason, bool all_exact, const PoseMap& map) {
    for (Found& found : found_) {
        const float reach = 2 + 0.5F * defect.length + std::sqrt(static_cast<float>(found.defect.area));
        if (std::hypot(found.defect.m - defect.m, found.defect.n - defect.n) > reach) continue;
        found.defect.score = std::max(found.defect.score, defect.score);
        return;
    }
    Region region;  // of it only the depth counts
    region.max_shift = region.max_scattering =
        reason == Reason::absorption || reason == Reason::missing_material ? 0 : defect.peak;
    if (defect.area < recipe_.min_area || (all_exact && tolerated(defect, region, map))) return;
    found_.push_back({defect, reason, 0});
}

// Returns the score of the squares of lenslets, over its limit.
float ReferenceDefects::find_patch(const ComparedFrame& compared, bool all_exact, const PoseMap& map) {
    if (reference_.patch_limit <= 0) return 0;
    patches_.load(compared.differences, compared.mask, reference_);
    for (const Defect& d : allowed_) patches_.leave_out(d.m, d.n, 2 + std::sqrt(static_cast<float>(d.area)));
    const LightPatch patch = patches_.strongest(0.5F * patch_limit_);
    const float of_limit = std::abs(patch.score) / patch_limit_;
    if (of_limit < 1) return of_limit;
    Defect defect{.m = patch.m, .n = patch.n};
    defect.area = static_cast<std::uint32_t>(patch.side * patch.side);
    defect.length = defect.width = static_cast<float>(patch.side);
    defect.peak = std::abs(patch.change);
    defect.score = of_limit;
    defect.weak = true;
    defect.kind = patch.change < 0 ? DefectKind::absorbing : DefectKind::unknown;
    add_weak(defect, patch.change < 0 ? Reason::absorption : Reason::missing_material, all_exact, map);
    return of_limit;
}

bool ReferenceDefects::tolerated(const Defect& d, const Region& r, const PoseMap& pose) {
    const auto place = pose.to_reference(static_cast<double>(d.m), static_cast<double>(d.n));
    const float disc = 2 * std::sqrt(static_cast<float>(d.area) * std::numbers::inv_pi_v<float>);
    const float size_mm = (d.kind == DefectKind::scratch ? d.length : disc) * recipe_.lenslet_mm;
    const float depth_rad = std::max(r.max_shift, r.max_scattering) * recipe_.bin_rad;
    for (std::size_t t = 0; t < used_.size(); ++t) {
        const Tolerance& tolerance = recipe_.tolerances[t];
        if (!tolerance.applies_to(d.kind) || used_[t] >= tolerance.number) continue;
        if (tolerance.where && !tolerance.where->contains(static_cast<float>(place.m), static_cast<float>(place.n)))
            continue;
        if (size_mm > tolerance.largest_mm || (tolerance.deepest_rad > 0 && depth_rad > tolerance.deepest_rad))
            continue;
        ++used_[t];
        return true;
    }
    return false;
}

FoundDefects ReferenceDefects::find(const ComparedFrame& compared, const Pose& pose, bool all_exact) {
    if (!compared.bounds.empty()) {  // what was solved
        const auto is_solved = [bounds = compared.bounds, mask = compared.mask](std::size_t k) {
            return (bounds[k] == 0) & ((mask[k] & (kNoGradient | kNotJudged)) == 0);
        };
        for_each_suiting(0, severity_.size(), is_solved,
                         [&](std::size_t k) { severity_[k] = severity_now(compared, k); });
    }
    std::ranges::fill(visited_, std::uint8_t{0});
    std::ranges::fill(used_, 0U);
    found_.clear();
    allowed_.clear();
    defects_.clear();
    const float grow = grow_severity();
    const PoseMap map(pose, extents_);
    float below = 0;  // the largest severity that is no defect
    const auto take_region = [&](std::size_t k) {
        if (visited_[k] != 0) return;
        const Region region = grow_region(static_cast<std::uint32_t>(k), compared);
        Reason reason = Reason::none;
        const Defect defect = describe(region, reason);
        const bool counts = defect.score >= 1 && defect.area >= std::max(recipe_.min_area, 1U),
                   allowed = counts && all_exact && tolerated(defect, region, map);
        if (allowed) allowed_.push_back(defect);
        if (!counts || allowed) {
            below = std::max(below, std::min(defect.score, 0.999F));
            return;
        }
        found_.push_back({defect, reason, static_cast<std::uint32_t>(k)});
    };
    const std::span<const float> severity = severity_, without = without_emd_;
    for_each_suiting(
        0, severity.size(), [=](std::size_t k) { return severity[k] >= grow; }, take_region);
    // Of a bound only what is exact counts.
    const auto take_largest = [&](auto&& is_exact) {
        const auto exact = [=](std::size_t k) { return is_exact(k) ? severity[k] : without[k]; };
        for_each_suiting(
            0, severity.size(), [=, &below](std::size_t k) { return (severity[k] < grow) & (exact(k) > below); },
            [&](std::size_t k) { below = exact(k); });
    };
    if (compared.bounds.empty()) take_largest([](std::size_t) { return true; });
    else take_largest([bounds = compared.bounds](std::size_t k) { return bounds[k] == 0; });
    const float of_patch = find_patch(compared, all_exact, map);
    below = std::max(below, std::min(of_patch, 0.999F));
    float by_lenslets = std::max(below, of_patch), together = 0;
    for (const Found& f : found_) by_lenslets = std::max(by_lenslets, f.defect.score);
    if (pooled_) {
        PooledPeak peak = pooled_->highest(compared.differences, compared.mask, reference_);
        together = peak.score;
        const float of_limit = together / recipe_.pooled_score;
        below = std::max(below, std::min(of_limit, 0.999F));
        if (of_limit >= 1) {
            pooled_->find(peak, compared.differences);
            Reason reason = Reason::none;
            Defect defect = describe(peak, reason);
            defect.score = of_limit;
            add_weak(defect, reason, all_exact, map);
        }
    }
    if (found_.empty()) return {{}, Reason::none, below, together, by_lenslets};
    std::ranges::sort(found_, [](const auto& a, const auto& b) {
        if (a.defect.score != b.defect.score) return a.defect.score > b.defect.score;
        return std::pair(a.defect.n, a.defect.m) < std::pair(b.defect.n, b.defect.m);
    });
    if (compared.light) measure_worst(*compared.light, map);
    for (const Found& found : found_) defects_.push_back(found.defect);
    return {defects_, found_.front().reason, found_.front().defect.score, together, by_lenslets};
}

std::vector<std::string> problems_of_reference(const Recipe& recipe) {
    std::vector<std::string> messages;
    const auto level = [&](float value, const char* name) {
        if (!(value > 0 && value <= 1000)) messages.push_back(std::string(name) + " must be above 0, at most 1000");
    };
    level(recipe.reject_score, "reject_score");
    level(recipe.grow_score, "grow_score");
    level(recipe.cluster_score, "cluster_score");
    if (!(recipe.pooled_score >= 0 && recipe.pooled_score <= 1000))
        messages.emplace_back("pooled_score must be from 0 (not judged) to 1000");
    if (recipe.grow_score > recipe.reject_score) messages.emplace_back("grow_score must be at most reject_score");
    if (!(recipe.lenslet_mm >= 0) || !(recipe.bin_rad >= 0))
        messages.emplace_back("lenslet_mm and bin_rad must be above 0, or 0: not known");
    for (const Tolerance& t : recipe.tolerances) {
        if (!recipe.reference) messages.emplace_back("a tolerance needs a reference to tell kinds and sizes");
        if (recipe.lenslet_mm == 0) messages.emplace_back("a tolerance in mm needs lenslet_mm");
        if (t.deepest_rad > 0 && recipe.bin_rad == 0) messages.emplace_back("a tolerance in radians needs bin_rad");
    }
    return messages;
}

std::vector<std::string> mismatches_of_reference(const Recipe& recipe, const Extents& extents, int bits) {
    std::vector<std::string> messages;
    if (recipe.reference) {
        const Reference& r = *recipe.reference;
        const auto size = [](const Extents& e) {
            return std::to_string(e.m) + "x" + std::to_string(e.n) + " lenslets of " + std::to_string(e.i) + "x" +
                std::to_string(e.j) + " bins";
        };
        if (!(r.extents == extents))
            messages.push_back("the reference was learned from " + size(r.extents) + ", the frames have " +
                               size(extents));
        if (r.bits != bits)
            messages.push_back("the reference was learned from " + std::to_string(r.bits) +
                               "-bit samples, the frames have " + std::to_string(bits) + " bits");
        const LightLevels levels = light_levels(recipe, bits);
        if (r.levels.dark != levels.dark || r.levels.saturated != levels.saturated ||
            r.levels.min_sum != levels.min_sum) {
            messages.push_back("the reference was learned with other light levels (dark_dn " +
                               std::to_string(r.levels.dark) + ", min_sum_dn " + std::to_string(r.levels.min_sum) +
                               ", saturated_dn " + std::to_string(r.levels.saturated) + ")");
        }
    }
    return messages;
}

}  // namespace hord::algo
