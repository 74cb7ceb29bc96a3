#include "lab/report/scatter.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include <fmt/format.h>

namespace hord::lab {
namespace {

constexpr double kLeft = 0.08, kRight = 0.98, kBottom = 0.19, kTop = 0.92;  // of the picture
constexpr double kPlotWidth = Scatter::kWidth * (kRight - kLeft), kPlotHeight = Scatter::kHeight * (kTop - kBottom);

constexpr double kKeyHeight = 0.015;  // of the legend's lower edge
constexpr std::size_t kMinMarks = 3;

// Marks of a logarithmic axis at round numbers, kMinMarks at least: decades, or 1, 2 and 5, or every digit of each; in
// a range too narrow for these at even steps.
std::vector<double> log_marks(double low, double high) {
    constexpr std::array<double, 13> kDigits = {1, 1, 2, 5, 1, 2, 3, 4, 5, 6, 7, 8, 9};
    std::vector<double> marks;
    for (const auto digits :
         {std::span(kDigits).first(1), std::span(kDigits).subspan(1, 3), std::span(kDigits).subspan(4)}) {
        marks.clear();
        for (double decade = std::pow(10.0, std::floor(std::log10(low))); decade <= high; decade *= 10) {
            for (const double digit : digits) {
                if (decade * digit >= low && decade * digit <= high) marks.push_back(decade * digit);
            }
        }
        if (marks.size() >= kMinMarks) return marks;
    }
    for (double unit = std::pow(10.0, std::floor(std::log10(high - low)));; unit /= 10) {
        for (const double step : {5 * unit, 2 * unit, unit}) {
            marks.clear();
            for (double k = std::ceil(low / step); k * step <= high; ++k) marks.push_back(k * step);
            if (marks.size() >= kMinMarks) return marks;
        }
    }
}

struct Box {
    double x0, y0, x1, y1;
};

}  // namespace

double Scatter::px(const Point& p) const { return x_.place(p.x) * kPlotWidth; }
double Scatter::py(const Point& p) const { return y_.place(p.y) * kPlotHeight; }

std::string Scatter::script() const {
    std::string text = "$points << EOD\n";
    for (const Point& p : points_) text += fmt::format("{} {} {}\n", p.x, p.y, p.kind);
    text += fmt::format(
        "EOD\nset lmargin at screen {}\nset rmargin at screen {}\nset bmargin at screen {}\nset tmargin at screen {}\n",
        kLeft, kRight, kBottom, kTop);
    text += fmt::format("set xrange [{}:{}]\nset yrange [{}:{}]\n{}{}", x_.low, x_.high, y_.low, y_.high,
                        x_.logarithmic ? "set logscale x\n" : "", y_.logarithmic ? "set logscale y\n" : "");
    for (const auto& [axis, name] : {std::pair(&x_, 'x'), std::pair(&y_, 'y')}) {
        if (!axis->logarithmic) continue;
        std::string marks;
        for (const double mark : log_marks(axis->low, axis->high))
            marks += fmt::format("{0}\"{1:.6g}\" {1:.6g}", marks.empty() ? "" : ", ", mark);
        text += fmt::format("set {}tics ({})\n", name, marks);
    }
    text += fmt::format("set key at screen {},{} bottom center horizontal maxrows 2 font ',9' samplen 2\n",
                        (kLeft + kRight) / 2, kKeyHeight);
    std::vector<Box> taken;
    for (const Point& p : points_) taken.push_back({px(p) - 5, py(p) - 5, px(p) + 5, py(p) + 5});
    for (const Point& p : points_) {
        // Tries right, then left, then places farther and farther up and down, with a line to the point.
        const double width = 6.2 * static_cast<double>(p.name.size()) + 4;
        constexpr double kLine = 12;
        for (int ring = 0; ring < 40; ++ring) {
            const double dy =
                -7 + (ring / 2 + 1) / 2 * kLine * ((ring / 2) % 2 == 0 ? 1 : -1);  // below the line of the front
            const double left = ring % 2 == 0 ? px(p) + 9 : px(p) - 9 - width;
            const Box box{left, py(p) + dy - 6, left + width, py(p) + dy + 6};
            const bool free =
                box.x0 > 0 && box.x1 < kPlotWidth && box.y0 > 0 && box.y1 < kPlotHeight &&
                std::ranges::none_of(taken, [&](const Box& other) {
                    return box.x0 < other.x1 && other.x0 < box.x1 && box.y0 < other.y1 && other.y0 < box.y1;
                });
            if (!free) continue;
            taken.push_back(box);
            text += fmt::format("set label \"{}\" at graph {:.4f},{:.4f} left font ',8'\n", p.name,
                                (left + 2) / kPlotWidth, (py(p) + dy) / kPlotHeight);
            if (ring >= 2) {
                text += fmt::format(
                    "set arrow from graph {:.4f},{:.4f} to graph {:.4f},{:.4f} nohead lw 0.5 lc rgb '#999999'\n",
                    px(p) / kPlotWidth, py(p) / kPlotHeight, (ring % 2 == 0 ? left : box.x1) / kPlotWidth,
                    (py(p) + dy) / kPlotHeight);
            }
            break;
        }
    }
    return text;
}

}  // namespace hord::lab
