#include "calib/lattice/autocorrelation.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace hord::calib {
namespace {

std::vector<float> of_window(int count, int reach) {
    const std::vector<float> window = hann(count);
    std::vector<float> lags(static_cast<std::size_t>(reach) + 3);
    for (std::size_t lag = 0; lag < lags.size(); ++lag) {
        for (std::size_t k = 0; k + lag < window.size(); ++k) lags[lag] += window[k] * window[k + lag];
    }
    const float zero = lags[0];
    for (float& lag : lags) lag = std::max(lag / zero, 1e-3F);
    return lags;
}

}  // namespace

std::vector<float> hann(int count) {
    std::vector<float> window(static_cast<std::size_t>(count));
    for (int k = 0; k < count; ++k) {
        window[static_cast<std::size_t>(k)] =
            static_cast<float>(0.5 - 0.5 * std::cos(2 * std::numbers::pi * (k + 0.5) / count));
    }
    return window;
}

Autocorrelation::Autocorrelation(const cv::Mat1f& windowed)
    : reach_x_(static_cast<int>(0.45 * windowed.cols)), reach_y_(static_cast<int>(0.45 * windowed.rows)) {
    const int width = cv::getOptimalDFTSize(windowed.cols + reach_x_);
    const int height = cv::getOptimalDFTSize(windowed.rows + reach_y_);
    cv::Mat1f padded(height, width, 0.0F);
    windowed.copyTo(padded(cv::Rect(0, 0, windowed.cols, windowed.rows)));
    cv::Mat spectrum;
    cv::dft(padded, spectrum, 0, windowed.rows);
    cv::Mat power;
    cv::mulSpectrums(spectrum, spectrum, power, 0, true);
    cv::dft(power, lags_, cv::DFT_INVERSE | cv::DFT_REAL_OUTPUT | cv::DFT_SCALE);
    across_ = of_window(windowed.cols, reach_x_);
    down_ = of_window(windowed.rows, reach_y_);
    zero_ = std::max(lags_(0, 0), 1e-20F);
}

std::optional<Autocorrelation::Peak> Autocorrelation::peak_near(Vec near, int reach) const {
    if (!within(near, reach + 2)) return std::nullopt;
    int x = static_cast<int>(std::lround(near.x));
    int y = static_cast<int>(std::lround(near.y));
    const int start_x = x;
    const int start_y = y;
    for (bool moved = true; moved;) {
        moved = false;
        int best_x = x;
        int best_y = y;
        for (int dy = -1; dy <= 1; ++dy) {
            for (int dx = -1; dx <= 1; ++dx) {
                if (at(x + dx, y + dy) > at(best_x, best_y)) {
                    best_x = x + dx;
                    best_y = y + dy;
                    moved = true;
                }
            }
        }
        x = best_x;
        y = best_y;
        if (std::abs(x - start_x) > reach || std::abs(y - start_y) > reach) return std::nullopt;
    }
    const auto vertex = [](double left, double middle, double right) {
        const double curvature = left - 2 * middle + right;
        return curvature < 0 ? std::clamp(0.5 * (left - right) / curvature, -0.5, 0.5) : 0.0;
    };
    return Peak{{x + vertex(at(x - 1, y), at(x, y), at(x + 1, y)), y + vertex(at(x, y - 1), at(x, y), at(x, y + 1))},
                at(x, y)};
}

std::vector<Autocorrelation::Peak> peaks_of(const Autocorrelation& correlation, double shortest, double longest) {
    std::vector<Autocorrelation::Peak> peaks;
    const int reach_x = std::min(correlation.reach_x() - 3, static_cast<int>(longest) + 1);
    const int reach_y = std::min(correlation.reach_y() - 3, static_cast<int>(longest) + 1);
    for (int y = 0; y <= reach_y; ++y) {
        for (int x = -reach_x; x <= reach_x; ++x) {
            const double lag = std::hypot(x, y);
            if (lag < shortest || lag > longest || (y == 0 && x < 0)) continue;
            const float here = correlation.at(x, y);
            if (here <= 0) continue;
            bool highest = true;
            for (int dy = -2; dy <= 2 && highest; ++dy) {
                for (int dx = -2; dx <= 2 && highest; ++dx) highest = correlation.at(x + dx, y + dy) <= here;
            }
            if (!highest) continue;
            if (auto peak = correlation.peak_near({static_cast<double>(x), static_cast<double>(y)}, 2))
                peaks.push_back(*peak);
        }
    }
    std::sort(peaks.begin(), peaks.end(), [](const auto& a, const auto& b) { return norm(a.lag) < norm(b.lag); });
    return peaks;
}

}  // namespace hord::calib
