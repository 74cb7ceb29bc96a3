#include "algo/good_parts/false_rejects.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <utility>
#include <vector>

#include "common/statistics.h"

namespace hord::algo {
namespace {

// The tail bound is computed with more confidence than it is told with: what good parts really follow is not known
// (`hord-lab experiment guarantee` measures how often it holds).
constexpr double kTailConfidence = 0.98;
// If the largest value lies further from the mean than that of so many samples of a distribution, the sample does not
// follow it.
constexpr double kFits = 0.99;
// The tail bound is at least 1 / (kFurthest parts): no sample says what is rarer by far than itself.
constexpr double kFurthest = 50;
constexpr double kMinScore = 1e-3;

// ln P(at most k of n) at a share p of each.
double log_at_most(std::size_t k, std::size_t n, double p) {
    const double log_p = std::log(p), log_q = std::log1p(-p), count = static_cast<double>(n);
    double largest = -1e300, sum = 0;
    std::vector<double> terms;
    for (std::size_t i = 0; i <= k; ++i) {
        const double hits = static_cast<double>(i);
        terms.push_back(std::lgamma(count + 1) - std::lgamma(hits + 1) - std::lgamma(count - hits + 1) + hits * log_p +
                        (count - hits) * log_q);
        largest = std::max(largest, terms.back());
    }
    for (const double term : terms) sum += std::exp(term - largest);
    return largest + std::log(sum);
}

struct Moments {
    double mean = 0, deviation = 0, largest = 0;
    // Of the largest value, in standard deviations from the mean.
    [[nodiscard]] double reach() const { return (largest - mean) / deviation; }
};
Moments moments_of(std::span<const double> values) {
    Moments m;
    double squares = 0;
    m.largest = values.front();
    for (const double v : values) m.mean += v, m.largest = std::max(m.largest, v);
    m.mean /= static_cast<double>(values.size());
    for (const double v : values) squares += (v - m.mean) * (v - m.mean);
    m.deviation = std::sqrt(std::max(squares / static_cast<double>(values.size()), 1e-12));
    return m;
}

// Samples of the standard Gumbel distribution of a fixed size. Location and scale cancel out of everything that is
// computed in standard deviations from the mean, so their quantiles hold for every Gumbel distribution.
class GumbelSamples {
  public:
    explicit GumbelSamples(std::size_t size) {
        const std::size_t count = std::clamp<std::size_t>(4'000'000 / size, 500, 2000);
        std::mt19937_64 random(size);
        std::vector<double> sample(size);
        for (std::size_t k = 0; k < count; ++k) {
            for (double& v : sample) {
                const double uniform = (static_cast<double>(random() >> 11U) + 0.5) * 0x1p-53;
                v = -std::log(-std::log(uniform));
            }
            samples_.push_back(moments_of(sample));
        }
    }
    // The share of a distribution above a limit that is `away` standard deviations of the sample above its mean: what
    // it does not exceed with kTailConfidence.
    [[nodiscard]] double most_above(double away) const {
        std::vector<double> shares;
        for (const Moments& s : samples_) shares.push_back(share_above(s, away));
        return common::nth_smallest(std::span(shares),
                                    static_cast<std::size_t>(kTailConfidence * static_cast<double>(shares.size())));
    }
    // The same share, mean over the samples.
    [[nodiscard]] double mean_above(double away) const {
        double sum = 0;
        for (const Moments& s : samples_) sum += share_above(s, away);
        return sum / static_cast<double>(samples_.size());
    }
    // How far away the limit must be until that share is at most `share`: with kTailConfidence, or in the mean.
    [[nodiscard]] double away_for(double share, double (GumbelSamples::*above)(double) const) const {
        double low = 0, high = 1;
        while ((this->*above)(high) > share && high < 1e6) high *= 2;
        for (int step = 0; step < 40; ++step) {
            const double middle = (low + high) / 2;
            ((this->*above)(middle) > share ? low : high) = middle;
        }
        return high;
    }
    [[nodiscard]] double reach(double share) const {
        std::vector<double> all;
        for (const Moments& s : samples_) all.push_back(s.reach());
        return common::quantile(std::move(all), share);
    }

  private:
    [[nodiscard]] static double share_above(const Moments& s, double away) {
        return -std::expm1(-std::exp(-(s.mean + away * s.deviation)));
    }
    std::vector<Moments> samples_;
};

// Samples of the size that was last asked for by this thread.
const GumbelSamples& gumbel_samples(std::size_t size) {
    thread_local std::optional<std::pair<std::size_t, GumbelSamples>> last;
    if (!last || last->first != size) last.emplace(size, GumbelSamples(size));
    return last->second;
}

double log_of(double score) { return std::log(std::max(score, kMinScore)); }

std::vector<double> logs_of(std::span<const double> scores) {
    std::vector<double> logs;
    for (const double s : scores) logs.push_back(log_of(s));
    return logs;
}

// The mean and deviation of scores or of their logarithms, whichever says more above a limit.
struct BothMoments {
    Moments plain, logs;
    explicit BothMoments(std::span<const double> scores)
        : plain(moments_of(scores)), logs(moments_of(logs_of(scores))) {}
    [[nodiscard]] double most_above(double limit, const GumbelSamples& gumbel) const {
        // The share decreases with the distance: the smaller distance is the larger bound.
        return gumbel.most_above(
            std::min((limit - plain.mean) / plain.deviation, (log_of(limit) - logs.mean) / logs.deviation));
    }
    [[nodiscard]] double plain_limit_at(double away) const { return plain.mean + away * plain.deviation; }
    [[nodiscard]] double limit_at(double away) const {
        return std::max(plain_limit_at(away), std::exp(std::min(logs.mean + away * logs.deviation, 50.0)));
    }
};

// `above`: the share beyond a distance from the mean, of GumbelSamples.
double limit_at(std::span<const double> scores, double share, double (GumbelSamples::*above)(double) const,
                double (BothMoments::*limit)(double) const = &BothMoments::limit_at) {
    if (scores.empty()) return 0;
    constexpr double kAbove = 1.01;
    const double least = kAbove * std::max(*std::ranges::max_element(scores), kMinScore);
    if (scores.size() < 2) return least;
    return std::max(least, (BothMoments(scores).*limit)(gumbel_samples(scores.size()).away_for(share, above)));
}

std::string percent(double share) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2g %%", 100 * share);
    return text;
}

}  // namespace

double most_rejected(std::size_t rejected, std::size_t parts) {
    if (parts == 0 || rejected >= parts) return 1;
    if (rejected == 0) return -std::expm1(std::log(1 - kConfidence) / static_cast<double>(parts));
    double low = static_cast<double>(rejected) / static_cast<double>(parts), high = 1;
    for (int step = 0; step < 60; ++step) {
        const double middle = (low + high) / 2;
        (log_at_most(rejected, parts, middle) > std::log(1 - kConfidence) ? low : high) = middle;
    }
    return high;
}

std::size_t parts_needed(std::size_t rejected, double share) {
    std::size_t low = rejected, high = rejected + 1;
    while (most_rejected(rejected, high) > share) low = high, high *= 2;
    while (high - low > 1) {
        const std::size_t middle = (low + high) / 2;
        (most_rejected(rejected, middle) > share ? low : high) = middle;
    }
    return high;
}

FalseRejects false_rejects_at(std::span<const double> scores, double limit, std::optional<std::size_t> distinct) {
    FalseRejects r;
    r.parts = std::min(distinct.value_or(scores.size()), scores.size());
    r.rejected = static_cast<std::size_t>(std::ranges::count_if(scores, [&](double s) { return s >= limit; }));
    r.any = most_rejected(r.rejected, r.parts);
    if (r.parts < kMinTailParts) return r;
    const GumbelSamples& gumbel = gumbel_samples(r.parts);
    const BothMoments both(scores);
    if (both.logs.reach() <= gumbel.reach(kFits))
        r.tail = std::max(both.most_above(limit, gumbel), 1 / (kFurthest * static_cast<double>(r.parts)));
    return r;
}

double limit_for(std::span<const double> scores, double share) {
    return limit_at(scores, share, &GumbelSamples::most_above);
}

double predicted_limit(std::span<const double> scores, double share) {
    return limit_at(scores, share, &GumbelSamples::mean_above);
}

double predicted_light_tailed_limit(std::span<const double> scores, double share) {
    return limit_at(scores, share, &GumbelSamples::mean_above, &BothMoments::plain_limit_at);
}

std::string describe(const FalseRejects& r) {
    if (r.parts == 0) return "No good part was judged: nothing is known of false rejects.";
    std::string text = "Of all good parts at most " + percent(r.bound()) + " are rejected (95 % sure, from " +
        std::to_string(r.parts) + " distinct good part" + (r.parts == 1 ? "" : "s") + ", " +
        (r.rejected == 0 ? "none" : std::to_string(r.rejected)) + " of them rejected)";
    text += ".";
    if (r.tail && *r.tail < r.any) {
        text +=
            " If their worst scores or the logarithms of these follow a Gumbel distribution, which they do not "
            "contradict, at most " +
            percent(*r.tail) + ".";
    } else if (r.parts >= kMinTailParts && !r.tail) {
        text += " One worst score lies so far from the others that no distribution says more.";
    }
    const auto more = [&](double share) {
        const std::size_t needed = parts_needed(r.rejected, share);
        return needed > r.parts ? needed - r.parts : 0;
    };
    const std::size_t least = more(kGoalFalseRejects), aimed = more(kAimedFalseRejects);
    if (aimed == 0) return text;
    text += " Without an assumption ";
    if (least > 0) text += percent(kGoalFalseRejects) + " takes " + std::to_string(least) + " more parts, ";
    text += percent(kAimedFalseRejects) + " " + (least > 0 ? "" : "takes ") + std::to_string(aimed) + " more" +
        (r.rejected == 0 ? ", none of them rejected." : ", no further one rejected.");
    return text;
}

}  // namespace hord::algo
