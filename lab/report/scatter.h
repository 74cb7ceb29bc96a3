// A scatter plot for gnuplot, with labels that do not overlap.
#pragma once

#include <cmath>
#include <string>
#include <vector>

namespace hord::lab {

class Scatter {
  public:
    static constexpr int kWidth = 1000, kHeight = 640;  // px

    struct Axis {
        double low, high;
        bool logarithmic;
        [[nodiscard]] double place(double v) const {
            return logarithmic ? std::log(v / low) / std::log(high / low) : (v - low) / (high - low);
        }
    };
    Scatter(const Axis& x, const Axis& y) : x_(x), y_(y) {}

    // `kind` is the third column of the point's line, to draw kinds differently.
    void add(double x, double y, const std::string& name, int kind) { points_.push_back({x, y, name, kind}); }

    // Data block $points, ranges, marks at round numbers, labels, and the legend below the plot, where nothing crosses
    // it; a `plot` command follows.
    [[nodiscard]] std::string script() const;

  private:
    struct Point {
        double x, y;
        std::string name;
        int kind;
    };
    [[nodiscard]] double px(const Point& p) const;
    [[nodiscard]] double py(const Point& p) const;

    Axis x_, y_;
    std::vector<Point> points_;
};

}  // namespace hord::lab
