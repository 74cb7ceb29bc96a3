#include "algo/reference/spread_estimate.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "algo/frame/mask.h"
#include "algo/reference/edge_classes.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

// Standard deviations of good parts that interpolation between lenslets alone makes: part of every score's noise.
constexpr float kInterpolation[kDeviations] = {0.05F, 0.05F, 0.02F, 0.05F};
constexpr float kMinSpread[kDeviations] = {1e-6F, 1e-5F, 1e-5F, 0};  // rounding: 0.1 % of light, 0.003 bin

// Heavy tails: near edges a part deviates far in few lenslets, by where the edge lies between them, and the next part
// does so elsewhere along the edge. What good parts reach is the second-largest squared deviation, each of another
// part: beside a jump of the reference, of all lenslets as far from a jump of that size; elsewhere of the lenslets
// within kTailReach.
constexpr int kTailReach = 5;  // lenslets
// The next good part may go so many times as far as the learned ones: kSafety times as all of them but one did beyond
// the others.
constexpr double kSafety = 2, kMaxMargin = 4;
// A deviation that just is a defect by the default recipe, squared, over its variance; of shape: the excess over the
// mean one, and over the standard deviation of its noise.
constexpr double kDefect[kDeviations] = {36, 18, 36, 27.5}, kDefectOfNoise[kDeviations] = {36, 18, 36, 14};
// Between a dark lenslet and a lit one, interpolation expects light by where the part lies. If less than half of the
// parts are expected to have it, the next good part may lack all of it: a deviation of -1.
constexpr auto kSpreadOfNoLight = static_cast<float>(kSafety * kSafety / kDefect[0]);
constexpr double kNoiseOfShape = 6;  // standard deviations that the excess reaches by noise alone
constexpr double kExplained = 0.5;   // of that: less needs no other explanation than noise and the local spread

// Expected largest of so many squared normal variables.
double largest_square(double count) { return 2 * std::log(count) - 0.6; }

// Largest share that one of `parts` squared normal variables may have of their sum (Grubbs' test; exceeded with a
// probability of about 0.001).
double grubbs_share(double parts) {
    const double t = 4.4 + 28 / (parts - 2), t2 = t * t;
    return (parts - 1) / parts * t2 / (parts - 2 + t2);
}

}  // namespace

double median_or_0(std::vector<double> values) { return values.empty() ? 0 : common::upper_median(std::span(values)); }

SpreadEstimate::SpreadEstimate(const Extents& extents) : extents_(extents), sums_(extents.lenslets()) {}

void SpreadEstimate::add(std::uint32_t part, const Difference& d, float emd, float frobenius) {
    if (!d.has_light) return;
    Sums& s = sums_[d.at];
    double score = 0;
    const auto add = [&](Deviation which, float square, float variance) {
        const auto w = static_cast<std::size_t>(which);
        s.squares[w] += square;
        s.largest[w].add(square, part);
        s.variance[w] += variance;
        score += static_cast<double>(square / (variance + kInterpolation[w] * kInterpolation[w]));
    };
    ++s.count;
    add(Deviation::light, d.light * d.light, d.light_variance);
    if (d.has_hord) {
        ++s.hords;
        for (const auto& [of, value] : {std::pair{0U, emd}, std::pair{1U, frobenius}})
            s.gradients[of] += value, s.largest_gradients[of].add(value, part);
        add(Deviation::deflection_shift, (d.x * d.x + d.y * d.y) / 2, (d.x_variance + d.y_variance) / 2);
        add(Deviation::scattering, d.scattering * d.scattering, d.scattering_variance);
        const auto w = static_cast<std::size_t>(Deviation::shape);
        const float excess = (d.chi2 - d.degrees) / d.sum;
        s.squares[w] += excess;
        s.largest[w].add(excess, part);
        s.variance[w] += std::sqrt(2 * d.degrees) / d.sum;
        score += static_cast<double>(std::max(0.0F, excess / (std::sqrt(2 * d.degrees) / d.sum + kInterpolation[w])));
        if (chi2_ratios_.size() < 4'000'000) chi2_ratios_.push_back(static_cast<double>(d.chi2 / d.degrees));
    }
    s.scores += static_cast<float>(score);
    if (static_cast<float>(score) > s.largest_score) {
        s.largest_score = static_cast<float>(score);
        s.largest_part = part;
    }
}

// The trimmed mean over 3x3 lenslets.
std::vector<float> SpreadEstimate::local_spread(std::size_t w, double parts) const {
    const std::size_t count = extents_.lenslets();
    const double largest = largest_square(parts),
                 trimmed = 1 / (parts - largest);                  // 1 / the expected sum of the others
    std::vector<float> tail(count, 0), trimmed_excess(count, -1);  // tail: excess variance that the largest implies
    for (std::size_t k = 0; k < count; ++k) {
        const Sums& s = sums_[k];
        const double all = values(k, w);
        if (2 * all < parts) continue;
        const auto others = static_cast<double>(s.squares[w] - s.largest[w].value(0));
        if (w == static_cast<std::size_t>(Deviation::shape)) {
            trimmed_excess[k] = static_cast<float>(others / std::max(1.0, all - 1));
            continue;
        }
        const auto noise_here = static_cast<double>(noise(k, w));
        // Two standard errors of the mean of nine lenslets are added: the spread may be larger than estimated, and with
        // more light it is all that remains of the variance.
        const double unsure = 2 * noise_here * std::sqrt(2 / (9 * parts));
        trimmed_excess[k] = static_cast<float>(unsure + others * trimmed * parts / all - noise_here);
        tail[k] = static_cast<float>(static_cast<double>(s.largest[w].value(0)) / largest - noise_here + unsure);
    }
    std::vector<float> spread(count, 0);
    std::vector<double> tails;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            double sum = 0;
            tails.clear();
            extents_.for_each_around(m, n, 1, [&](int x, int y) {
                const std::size_t k = extents_.index(x, y);
                if (2 * values(k, w) < parts) return;
                sum += static_cast<double>(trimmed_excess[k]);
                tails.push_back(static_cast<double>(tail[k]));
            });
            const double mean = tails.empty() ? 0 : sum / static_cast<double>(tails.size());
            spread[extents_.index(m, n)] =
                std::max(kMinSpread[w], static_cast<float>(std::max(mean, median_or_0(tails))));
        }
    }
    return spread;
}

// Variance of a deviation by noise alone, mean over the parts; of shape: standard deviation of the excess.
float SpreadEstimate::noise(std::size_t k, std::size_t w) const {
    return static_cast<float>(static_cast<double>(sums_[k].variance[w]) / std::max(1.0, values(k, w)));
}

// The largest values of the parts near each lenslet, or in its edge class.
template <class LargestOf>
std::vector<LargestByPart> SpreadEstimate::reached(std::span<const std::int16_t> edge_class,
                                                   const LargestOf& largest_of) const {
    const Extents& e = extents_;
    std::vector<LargestByPart> along(sums_.size()), around(sums_.size());
    std::array<LargestByPart, kEdgeClasses> of_class;
    const auto for_near = [](int at, int end, auto&& visit) {
        for (int near = std::max(0, at - kTailReach); near <= std::min(end - 1, at + kTailReach); ++near) visit(near);
    };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            if (edge_class[k] >= 0) of_class[static_cast<std::size_t>(edge_class[k])].add(largest_of(k));
            for_near(m, e.m, [&](int x) {
                const std::size_t at = e.index(x, n);
                if (edge_class[at] < 0) along[k].add(largest_of(at));
            });
        }
    }
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            if (edge_class[k] >= 0) {
                const int same = edge_class[k], step = kEdgeReach + 1;
                for (const int of : {same - step, same, same + step}) {
                    if (of >= 0 && of < int{kEdgeClasses}) around[k].add(of_class[static_cast<std::size_t>(of)]);
                }
            } else for_near(n, e.n, [&](int y) { around[k].add(along[e.index(m, y)]); });
        }
    }
    return around;
}

// How many times as far as the others reach the next part may go, squared; 0 if not two of the parts go beyond what
// noise and the local spread explain. Of lenslets near jumps, or of all others.
double SpreadEstimate::margin(std::size_t w, double parts, std::span<const float> spread, const Tails& tails,
                              bool near_jumps) const {
    LargestByPart ratios;
    for (std::size_t k = 0; k < sums_.size(); ++k) {
        if (2 * values(k, w) < parts || (tails.edge_class[k] >= 0) != near_jumps) continue;
        const double explained = kExplained *
            (kDefect[w] * static_cast<double>(spread[k]) + kDefectOfNoise[w] * static_cast<double>(noise(k, w)));
        const LargestByPart& largest = sums_[k].largest[w];
        for (std::size_t rank = 0; rank < LargestByPart::kKept; ++rank) {
            const std::uint32_t part = largest.part(rank);
            const float square = largest.value(rank), others = tails.reached[k].second_without(part);
            if (static_cast<double>(square) > explained && others > 0) ratios.add(square / others, part);
        }
    }
    const auto beyond = static_cast<double>(ratios.value(1));
    return beyond > 0 ? std::clamp(kSafety * kSafety * beyond, kSafety * kSafety, kMaxMargin * kMaxMargin) : 0;
}

// The mean of the parts. Near jumps the gradient depends on where the edge lies between the lenslets: there it is what
// good parts reach at such edges, the second largest of all parts.
std::vector<float> SpreadEstimate::usual_gradient(std::size_t which, std::span<const std::int16_t> edge_class) const {
    const auto reaches = reached(edge_class, [&](std::size_t k) { return sums_[k].largest_gradients[which]; });
    std::vector<float> usual(sums_.size(), 0);
    for (std::size_t k = 0; k < sums_.size(); ++k) {
        if (sums_[k].hords > 0) usual[k] = sums_[k].gradients[which] / sums_[k].hords;
        if (edge_class[k] >= 0) usual[k] = std::max(usual[k], reaches[k].value(1));
    }
    return usual;
}

void SpreadEstimate::finish(double parts, Reference& reference) const {
    const std::size_t count = extents_.lenslets();
    Tails tails{edge_classes(reference), {}};
    const double of_noise = largest_square(parts * (2 * kTailReach + 1) * (2 * kTailReach + 1));
    for (std::size_t w = 0; w < kDeviations; ++w) {
        std::vector<float>& spread = reference.spread[w];
        spread = local_spread(w, parts);
        tails.reached = reached(tails.edge_class, [&](std::size_t k) { return sums_[k].largest[w]; });
        const double elsewhere = margin(w, parts, spread, tails, false),
                     near_jumps = margin(w, parts, spread, tails, true);
        const bool of_light = w == static_cast<std::size_t>(Deviation::light);
        const double noise_reaches = w == static_cast<std::size_t>(Deviation::shape) ? kNoiseOfShape : of_noise;
        for (std::size_t k = 0; k < count; ++k) {
            const double beyond =
                static_cast<double>(tails.reached[k].value(1)) - noise_reaches * static_cast<double>(noise(k, w));
            const double times = tails.edge_class[k] >= 0 ? near_jumps : elsewhere;
            spread[k] = std::max(spread[k], static_cast<float>(times * beyond / kDefect[w]));
            if (of_light && 2 * values(k, w) < parts) spread[k] = std::max(spread[k], kSpreadOfNoLight);
        }
    }
    reference.emd = usual_gradient(0, tails.edge_class);
    reference.frobenius = usual_gradient(1, tails.edge_class);
}

std::vector<double> SpreadEstimate::sole_deviations(std::size_t count, double parts) const {
    const double share = grubbs_share(parts);
    std::vector<double> lenslets(count, 0);
    for (const Sums& s : sums_) {
        if (s.largest_score > 25 && static_cast<double>(s.largest_score) > share * static_cast<double>(s.scores))
            ++lenslets[s.largest_part];
    }
    return lenslets;
}

}  // namespace hord::algo
