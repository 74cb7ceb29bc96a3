#include "lab/report/statistics.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "hal_sim/optics/scene/noise.h"

namespace hord::lab {
namespace {

constexpr std::uint32_t kBootstrap = 0xB007;  // purpose of these random numbers

// Scores in descending order, and the statistics of a draw of parts.
class RocCurve {
  public:
    explicit RocCurve(std::span<const ScoredPlace> scores) : scores_(scores.begin(), scores.end()) {
        std::ranges::sort(scores_, [](const ScoredPlace& a, const ScoredPlace& b) { return a.score > b.score; });
    }

    struct Point {
        double auc = 0, tpr = 0;
        float threshold = 0;
    };
    // times[part]: how often the part was drawn. Empty if no good or no bad place was drawn.
    [[nodiscard]] std::optional<Point> measure(std::span<const int> times, double fpr) const {
        double good = 0, bad = 0;
        for (const ScoredPlace& s : scores_) (s.bad ? bad : good) += times[s.part];
        if (!(good > 0 && bad > 0)) return std::nullopt;
        Point point;
        point.threshold = scores_.front().score;
        double good_above = 0, bad_above = 0, area = 0;
        for (std::size_t k = 0; k < scores_.size();) {
            double good_here = 0, bad_here = 0;
            const float score = scores_[k].score;
            for (; k < scores_.size() && scores_[k].score == score; ++k)
                (scores_[k].bad ? bad_here : good_here) += times[scores_[k].part];
            area += good_here * (bad_above + bad_here / 2);
            good_above += good_here;
            bad_above += bad_here;
            if (good_above <= fpr * good) {
                point.tpr = bad_above / bad;
                point.threshold = k < scores_.size() ? scores_[k].score : score;
            }
        }
        point.auc = area / (good * bad);
        return point;
    }

  private:
    std::vector<ScoredPlace> scores_;
};

Estimate with_interval(double value, const std::vector<double>& draws) {
    return {value, quantile(draws, 0.025), quantile(draws, 0.975)};
}

// Calls use(times) for each draw: times[part] is the number of times the part was drawn.
template <class Use>
void bootstrap(std::uint32_t parts, int repeats, std::uint64_t seed, Use use) {
    std::vector<int> times(parts);
    for (int repeat = 0; repeat < repeats; ++repeat) {
        sim::Noise draw(seed, static_cast<std::uint64_t>(repeat), kBootstrap);
        std::ranges::fill(times, 0);
        for (std::uint32_t k = 0; k < parts; ++k) ++times[static_cast<std::size_t>(draw.uniform() * parts)];
        use(times);
    }
}

std::uint32_t parts_of(std::span<const ScoredPlace> scores) {
    std::uint32_t parts = 0;
    for (const ScoredPlace& s : scores) parts = std::max(parts, s.part + 1);
    return parts;
}

}  // namespace

Detection detection_of(std::span<const ScoredPlace> scores, double fpr, int repeats, std::uint64_t seed) {
    const std::uint32_t parts = parts_of(scores);
    const RocCurve curve(scores);
    const auto whole = curve.measure(std::vector<int>(parts, 1), fpr);
    if (!whole) return {};
    std::vector<double> aucs, tprs;
    bootstrap(parts, repeats, seed, [&](const std::vector<int>& times) {
        const auto point = curve.measure(times, fpr);
        if (!point) return;
        aucs.push_back(point->auc);
        tprs.push_back(point->tpr);
    });
    return {with_interval(whole->auc, aucs), with_interval(whole->tpr, tprs), whole->threshold};
}

Estimate auc_difference(std::span<const ScoredPlace> a, std::span<const ScoredPlace> b, int repeats,
                        std::uint64_t seed) {
    const std::uint32_t parts = parts_of(a);
    const RocCurve of_a(a), of_b(b);
    const auto difference = [&](const std::vector<int>& times) -> std::optional<double> {
        const auto at_a = of_a.measure(times, 0), at_b = of_b.measure(times, 0);
        if (!at_a || !at_b) return std::nullopt;
        return at_a->auc - at_b->auc;
    };
    const auto whole = difference(std::vector<int>(parts, 1));
    if (!whole) return {};
    std::vector<double> draws;
    bootstrap(parts, repeats, seed, [&](const std::vector<int>& times) {
        if (const auto one = difference(times)) draws.push_back(*one);
    });
    return with_interval(*whole, draws);
}

double gumbel_limit(std::span<const double> good, double share) {
    double mean = 0, square = 0, worst = 0;
    for (const double score : good) {
        mean += score, square += score * score;
        worst = std::max(worst, score);
    }
    if (good.empty()) return 0;
    const auto count = static_cast<double>(good.size());
    mean /= count;
    const double beta = std::sqrt(std::max(1e-12, square / count - mean * mean)) * std::sqrt(6.0) / std::numbers::pi;
    return std::max(worst, mean - std::numbers::egamma * beta - beta * std::log(-std::log(1 - share)));
}

double limit_above(double value) {
    if (!(value > 0)) return 0;
    const double digit = std::pow(10.0, std::floor(std::log10(value)) - 2);
    return std::ceil(value / digit + 0.01) * digit;  // 1e-7 at 1e-3: more than 1 - limit is rounded by
}

double tail_limit(std::vector<double> values, double above) {
    if (values.empty()) return 0;
    std::ranges::sort(values, std::greater<>());
    const std::size_t peaks = std::min(values.size() - 1, std::max<std::size_t>(10, values.size() / 10));
    const double worst = values.front(), threshold = values[peaks];
    if (peaks < 3 || !(worst > threshold)) return worst;
    // Probability-weighted moments of the excesses: the mean, and the mean weighted with the share of larger excesses.
    const auto count = static_cast<double>(peaks);
    double mean = 0, weighted = 0;
    for (std::size_t k = 0; k < peaks; ++k) {
        const double excess = values[k] - threshold;
        mean += excess / count;
        weighted += excess * static_cast<double>(k) / ((count - 1) * count);
    }
    const double shape = std::max(0.0, 2 - mean / (mean - 2 * weighted)), scale = shape > 0 ? mean * (1 - shape) : mean;
    const double times = count / (static_cast<double>(values.size()) * above);  // share of peaks over `above`
    const double beyond = shape > 1e-6 ? scale * (std::pow(times, shape) - 1) / shape : scale * std::log(times);
    return std::max(worst, threshold + std::max(0.0, beyond));
}

}  // namespace hord::lab
