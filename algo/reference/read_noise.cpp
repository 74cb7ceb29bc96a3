#include "algo/reference/read_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kFarBins = 3;
constexpr std::uint32_t kBright = 8, kSupport = 16;
constexpr std::size_t kFrames = 8;
constexpr std::uint64_t kMinReadings = 1000;
constexpr double kMaxDeviations = 5;  // standard deviations from the median; beyond: outliers
constexpr double kMin = 0.25;         // DN: less cannot be distinguished from rounding

// Count of each reading. A dark bin's is below 1 / kSupport of the full scale.
using Histogram = std::vector<std::uint64_t>;

// One for each distance along i and j from the lenslet's brightest bin: diffracted light fills the bins along both
// axes.
using Histograms = std::array<Histogram, kMaxBins * kMaxBins>;

void add_dark_bins(const FrameView& frame, const Extents& e, std::uint32_t dark, Histograms& histograms) {
    const std::size_t readings = frame.full_scale() / kSupport + 1;
    std::array<bool, kMaxBins * kMaxBins> far{};
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto sample = [&](int i, int j) { return frame.sample(m * e.i + i, n * e.j + j); };
            const auto is_far = [&](int i, int j) -> bool& { return far[static_cast<std::size_t>(j * e.i + i)]; };
            std::uint32_t brightest = 0;
            int i_brightest = 0, j_brightest = 0;
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    if (sample(i, j) > brightest) brightest = sample(i, j), i_brightest = i, j_brightest = j;
                }
            }
            if (brightest < kBright * (dark + 1)) continue;
            far.fill(true);
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    if (sample(i, j) * kSupport < brightest) continue;
                    for (int y = std::max(0, j - kFarBins + 1); y < std::min(e.j, j + kFarBins); ++y) {
                        for (int x = std::max(0, i - kFarBins + 1); x < std::min(e.i, i + kFarBins); ++x)
                            is_far(x, y) = false;
                    }
                }
            }
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    if (!is_far(i, j)) continue;
                    Histogram& histogram = histograms[static_cast<std::size_t>(std::abs(j - j_brightest) * kMaxBins +
                                                                               std::abs(i - i_brightest))];
                    histogram.resize(readings);
                    ++histogram[std::min<std::size_t>(sample(i, j), readings - 1)];
                }
            }
        }
    }
}

// Of a normal variable of mean 0, rounded to integers: twice the sum over k >= 1 of k^2 times its probability.
double square_of_upper_half(double sigma) {
    const auto above = [&](double x) { return 0.5 * std::erfc(x / (sigma * std::numbers::sqrt2)); };
    double sum = 0;
    for (int k = 1; k < 3 + static_cast<int>(8 * sigma); ++k) sum += 2.0 * k * k * (above(k - 0.5) - above(k + 0.5));
    return sum;
}

// The standard deviation whose rounded upper half has this mean square.
double sigma_of(double square) {
    if (square > 4) return std::sqrt(square - 1.0 / 12);
    double low = kMin / 2, high = 3;
    for (int k = 0; k < 50; ++k) {
        const double middle = (low + high) / 2;
        (square_of_upper_half(middle) < square ? low : high) = middle;
    }
    return low < kMin ? 0 : low;
}

double noise_of(const Histogram& histogram, std::uint64_t readings) {
    std::size_t median = 0;
    for (std::uint64_t below = histogram[0]; 2 * below < readings; below += histogram[++median]) {
    }
    const bool clipped = histogram[0] * 100 > readings;
    double sigma = std::numeric_limits<double>::infinity();
    for (int round = 0; round < 5; ++round) {
        const double reach = kMaxDeviations * sigma + 1;
        double count = 0, sum = 0, squares = 0, upper = 0;
        for (std::size_t k = 0; k < histogram.size(); ++k) {
            const double off = static_cast<double>(k) - static_cast<double>(median),
                         n = static_cast<double>(histogram[k]);
            if (std::abs(off) > reach) continue;
            count += n, sum += n * off, squares += n * off * off;
            if (off > 0) upper += n * off * off;
        }
        if (clipped) {
            sigma = sigma_of(2 * upper / count);
        } else {
            const double mean = sum / count;
            sigma = std::sqrt(std::max(0.0, squares / count - mean * mean - 1.0 / 12));
        }
    }
    return sigma;
}

}  // namespace

Result<float> read_noise_of(const Extents& extents, const LightLevels& levels, std::size_t count,
                            const std::function<Result<Frame>(std::size_t)>& frame_of) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    Histograms histograms;
    for (std::size_t k = 0; k < std::min(count, kFrames); ++k) {
        const auto frame = frame_of(k);
        if (!frame) return tl::unexpected(frame.error());
        if (auto fine = check_frame(frame->view(), extents, frame->bits()); !fine) return tl::unexpected(fine.error());
        add_dark_bins(frame->view(), extents, levels.dark, histograms);
    }
    std::vector<double> noises;
    for (const Histogram& histogram : histograms) {
        const auto readings = std::accumulate(histogram.begin(), histogram.end(), std::uint64_t{0});
        if (readings >= kMinReadings) noises.push_back(noise_of(histogram, readings));
    }
    if (noises.empty()) {
        return fail(ErrorCode::invalid_argument,
                    "too few bins of these frames are without light to tell the read noise from them",
                    "give the sensor's, in DN, with --read-dn");
    }
    return static_cast<float>(common::quantile(std::move(noises), 0.25));
}

}  // namespace hord::algo
