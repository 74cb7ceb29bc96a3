#include "algo/reference/spread_estimate.h"

#include <algorithm>
#include <cmath>

#include "common/statistics.h"

namespace hord::algo {
namespace {

// Standard deviations of good parts that interpolation between lenslets alone makes: part of every score's noise.
constexpr float kInterpolation[kDeviations] = {0.05F, 0.05F, 0.02F, 0.05F};
constexpr float kMinSpread[kDeviations] = {1e-6F, 1e-5F, 1e-5F, 0};  // rounding: 0.1 % of light, 0.003 bin

// Heavy tails: near edges a part deviates far in few lenslets, by where the edge lies between them. Another part
// deviates as far elsewhere along the edge, hence the second-largest deviation within kTailReach lenslets, of another
// part than the largest: a flaw of one part does not count. If it is kHeavy times what a normal distribution of the
// spread makes, it counts as two standard deviations; an excess of shape as the mean.
constexpr int kTailReach = 3;
constexpr double kHeavy = 2;
constexpr float kTailDivisor[kDeviations] = {4, 4, 4, 1};

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
        if (square > s.largest[w]) s.largest[w] = square, s.part_of_largest[w] = part;
        s.variance[w] += variance;
        score += static_cast<double>(square / (variance + kInterpolation[w] * kInterpolation[w]));
    };
    ++s.count;
    add(Deviation::light, d.light * d.light, d.light_variance);
    if (d.has_hord) {
        ++s.hords;
        s.emd += emd;
        s.frobenius += frobenius;
        add(Deviation::deflection_shift, (d.x * d.x + d.y * d.y) / 2, (d.x_variance + d.y_variance) / 2);
        add(Deviation::scattering, d.scattering * d.scattering, d.scattering_variance);
        const auto w = static_cast<std::size_t>(Deviation::shape);
        const float excess = (d.chi2 - d.degrees) / d.sum;
        s.squares[w] += excess;
        if (excess > s.largest[w]) s.largest[w] = excess, s.part_of_largest[w] = part;
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

void SpreadEstimate::finish(double parts, Reference& reference) const {
    const std::size_t count = extents_.lenslets();
    const double own = parts / (parts - 1);  // corrects for each part's share in the mean
    const double largest = largest_square(parts);
    const double largest_around = largest_square(parts * (2 * kTailReach + 1) * (2 * kTailReach + 1));
    const double trimmed = 1 / (parts - largest);  // 1 / the expected sum of the others
    std::vector<float> tail(count, 0);             // excess variance that the largest deviation implies
    std::vector<double> tails;
    std::array<std::vector<float>, kDeviations> trimmed_excess;
    for (std::size_t w = 0; w < kDeviations; ++w) {
        trimmed_excess[w].assign(count, -1);
        std::ranges::fill(tail, 0.0F);
        for (std::size_t k = 0; k < count; ++k) {
            const Sums& s = sums_[k];
            const double values = w == 0 ? s.count : s.hords;
            if (2 * values < parts) continue;
            double excess = 0;
            if (w == static_cast<std::size_t>(Deviation::shape)) {
                excess = static_cast<double>(s.squares[w] - s.largest[w]) / std::max(1.0, values - 1);
            } else {
                const double noise = static_cast<double>(s.variance[w]) / values;
                // Two standard errors of the mean of nine lenslets are added: the spread may be larger than estimated,
                // and with more light it is all that remains of the variance.
                const double unsure = 2 * noise * std::sqrt(2 / (9 * parts));
                excess =
                    unsure + own * static_cast<double>(s.squares[w] - s.largest[w]) * trimmed * parts / values - noise;
                tail[k] = static_cast<float>(own * static_cast<double>(s.largest[w]) / largest - noise + unsure);
            }
            trimmed_excess[w][k] = static_cast<float>(excess);
        }
        auto& spread = reference.spread[w];
        spread.assign(count, 0);
        for (int n = 0; n < extents_.n; ++n) {
            for (int m = 0; m < extents_.m; ++m) {
                double sum = 0, number = 0;
                tails.clear();
                extents_.for_each_around(m, n, 1, [&](int x, int y) {
                    const std::size_t k = extents_.index(x, y);
                    if (2 * (w == 0 ? sums_[k].count : sums_[k].hords) < parts) return;
                    sum += static_cast<double>(trimmed_excess[w][k]);
                    number += 1;
                    tails.push_back(static_cast<double>(tail[k]));
                });
                const std::size_t k = extents_.index(m, n);
                spread[k] = std::max(kMinSpread[w],
                                     static_cast<float>(number > 0 ? std::max(sum / number, median_or_0(tails)) : 0));
                const double values = w == 0 ? sums_[k].count : sums_[k].hords;
                const float second = second_largest(m, n, w);
                const double usual = static_cast<double>(spread[k] + sums_[k].variance[w] / std::max(values, 1.0));
                if (static_cast<double>(second) > kHeavy * largest_around * usual)
                    spread[k] = std::max(spread[k], second / kTailDivisor[w]);
            }
        }
    }
    reference.emd.assign(count, 0);
    reference.frobenius.assign(count, 0);
    for (std::size_t k = 0; k < count; ++k) {
        if (sums_[k].hords == 0) continue;
        reference.emd[k] = sums_[k].emd / sums_[k].hords;
        reference.frobenius[k] = sums_[k].frobenius / sums_[k].hords;
    }
}

// Of squared deviations within kTailReach lenslets, by another part than the largest.
float SpreadEstimate::second_largest(int m, int n, std::size_t w) const {
    float largest = 0, second = 0;
    std::uint32_t part = 0;
    extents_.for_each_around(m, n, kTailReach, [&](int x, int y) {
        const Sums& s = sums_[extents_.index(x, y)];
        if (s.largest[w] > largest) {
            if (s.part_of_largest[w] != part) second = largest;
            largest = s.largest[w], part = s.part_of_largest[w];
        } else if (s.part_of_largest[w] != part) {
            second = std::max(second, s.largest[w]);
        }
    });
    return second;
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
