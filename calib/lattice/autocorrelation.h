// The autocorrelation of a windowed part of a frame: it peaks at the vectors of its lattice. Used by
// calib/lattice/lattice.cpp only.
#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include <opencv2/core.hpp>

namespace hord::calib {

using Vec = cv::Point2d;
inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y; }
inline double cross(Vec a, Vec b) { return a.x * b.y - a.y * b.x; }
inline double norm(Vec a) { return std::sqrt(dot(a, a)); }

// A window that falls to zero at both ends.
std::vector<float> hann(int count);

// Divided by that of the window; 1 at lag 0.
class Autocorrelation {
  public:
    explicit Autocorrelation(const cv::Mat1f& windowed);

    [[nodiscard]] bool within(Vec lag, double margin = 2) const {
        return std::abs(lag.x) < reach_x_ - margin && std::abs(lag.y) < reach_y_ - margin;
    }
    [[nodiscard]] float at(int x, int y) const {
        const int column = x < 0 ? x + lags_.cols : x;
        const int row = y < 0 ? y + lags_.rows : y;
        return lags_(row, column) /
            (zero_ * across_[static_cast<std::size_t>(std::abs(x))] * down_[static_cast<std::size_t>(std::abs(y))]);
    }
    [[nodiscard]] int reach_x() const { return reach_x_; }
    [[nodiscard]] int reach_y() const { return reach_y_; }

    struct Peak {
        Vec lag;
        double height = 0;
    };
    // The local maximum within `reach` px of `near`, by hill climbing, refined by parabolas; none if there is none.
    [[nodiscard]] std::optional<Peak> peak_near(Vec near, int reach) const;

  private:
    int reach_x_, reach_y_;
    cv::Mat1f lags_;
    std::vector<float> across_, down_;
    float zero_ = 1;
};

// Local maxima in the upper half plane at the lags a lenslet pitch may have, px.
std::vector<Autocorrelation::Peak> peaks_of(const Autocorrelation& correlation, double shortest, double longest);

}  // namespace hord::calib
