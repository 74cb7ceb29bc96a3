#include "firmware/experiment/tradeoff_plots.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include "firmware/experiment/tables.h"
#include "firmware/experiment/tradeoff_rating.h"

namespace hord::firmware {
namespace {

constexpr int kWidth = 1000, kHeight = 640;  // of a scatter plot, px

// Colours and dashes of kShown, in its order: against a reference dashed.
std::string line_of(std::size_t shown) {
    constexpr const char* kColours[] = {"#1f77b4", "#9467bd", "#17becf", "#8c564b", "#2ca02c", "#1f77b4", "#d62728", "#ff7f0e"};
    return fmt::format("lw 2 lc rgb '{}' {}", kColours[shown], std::string_view(kShown[shown]).starts_with("reference") ? "dt 2" : "dt 1");
}

// A scatter plot of named points whose names do not cover one another.
class Scatter {
  public:
    struct Axis {
        double low, high;
        bool logarithmic;
        [[nodiscard]] double place(double v) const { return logarithmic ? std::log(v / low) / std::log(high / low) : (v - low) / (high - low); }
    };
    Scatter(const Axis& x, const Axis& y) : x_(x), y_(y) {}

    void add(double x, double y, const std::string& name, Kind kind) { points_.push_back({x, y, name, kind}); }

    // Data block $points, ranges and labels; then what `plot` should draw of them.
    [[nodiscard]] std::string script() const {
        std::string text = "$points << EOD\n";
        for (const Point& p : points_) text += fmt::format("{} {} {}\n", p.x, p.y, static_cast<int>(p.kind));
        text += fmt::format("EOD\nset lmargin at screen {}\nset rmargin at screen {}\nset bmargin at screen {}\nset tmargin at screen {}\n", kLeft, kRight, kBottom, kTop);
        text += fmt::format("set xrange [{}:{}]\nset yrange [{}:{}]\n{}{}", x_.low, x_.high, y_.low, y_.high, x_.logarithmic ? "set logscale x\n" : "", y_.logarithmic ? "set logscale y\n" : "");
        std::vector<Box> taken;
        for (const Point& p : points_) taken.push_back({px(p) - 5, py(p) - 5, px(p) + 5, py(p) + 5});
        for (const Point& p : points_) {
            // To the right, to the left, then further and further up and down, with a line to the point.
            const double width = 6.2 * static_cast<double>(p.name.size()) + 4;
            constexpr double kLine = 12;
            for (int ring = 0; ring < 40; ++ring) {
                const double dy = -7 + (ring / 2 + 1) / 2 * kLine * ((ring / 2) % 2 == 0 ? 1 : -1);  // below the line of the front
                const double left = ring % 2 == 0 ? px(p) + 9 : px(p) - 9 - width;
                const Box box{left, py(p) + dy - 6, left + width, py(p) + dy + 6};
                const bool free = box.x0 > 0 && box.x1 < plot_width() && box.y0 > 0 && box.y1 < plot_height() &&
                                  std::ranges::none_of(taken, [&](const Box& other) { return box.x0 < other.x1 && other.x0 < box.x1 && box.y0 < other.y1 && other.y0 < box.y1; });
                if (!free) continue;
                taken.push_back(box);
                text += fmt::format("set label \"{}\" at graph {:.4f},{:.4f} left font ',8'\n", p.name, (left + 2) / plot_width(), (py(p) + dy) / plot_height());
                if (ring >= 2) {
                    text += fmt::format("set arrow from graph {:.4f},{:.4f} to graph {:.4f},{:.4f} nohead lw 0.5 lc rgb '#999999'\n", px(p) / plot_width(), py(p) / plot_height(),
                                        (ring % 2 == 0 ? left : box.x1) / plot_width(), (py(p) + dy) / plot_height());
                }
                break;
            }
        }
        return text;
    }
    static constexpr const char* kPoints =
        "$points using ($3==0?$1:1/0):2 with points pt 9 ps 1.4 lc rgb '#2ca02c' title 'the light alone', "
        "$points using ($3==1?$1:1/0):2 with points pt 7 lc rgb '#1f77b4' title 'over neighbours', "
        "$points using ($3==2?$1:1/0):2 with points pt 5 lc rgb '#d62728' title 'against a reference'\n";

  private:
    static constexpr double kLeft = 0.08, kRight = 0.98, kBottom = 0.1, kTop = 0.92;
    struct Point {
        double x, y;
        std::string name;
        Kind kind;
    };
    struct Box {
        double x0, y0, x1, y1;
    };
    [[nodiscard]] static double plot_width() { return kWidth * (kRight - kLeft); }
    [[nodiscard]] static double plot_height() { return kHeight * (kTop - kBottom); }
    [[nodiscard]] double px(const Point& p) const { return x_.place(p.x) * plot_width(); }
    [[nodiscard]] double py(const Point& p) const { return y_.place(p.y) * plot_height(); }

    Axis x_, y_;
    std::vector<Point> points_;
};

Scatter::Axis times_of(const std::vector<Rated>& all) {
    const auto [fastest, slowest] = std::ranges::minmax(all, {}, &Rated::median_ms);
    return {0.7 * fastest.median_ms, 1.6 * slowest.median_ms, true};
}

std::string pareto_script(const std::vector<Rated>& all) {
    std::vector<Rated> by_time = all;
    std::ranges::sort(by_time, {}, &Rated::median_ms);
    const double most_found = std::ranges::max(all, {}, &Rated::mean_tpr).mean_tpr();
    const Scatter::Axis times = times_of(all);
    Scatter scatter(times, {0, std::min(100.0, 110 * most_found + 5), false});
    std::string front;
    double most = -1;
    for (const Rated& r : by_time) {
        scatter.add(r.median_ms, 100 * r.mean_tpr(), r.name, r.kind);
        if (100 * r.mean_tpr() <= most) continue;
        front += fmt::format("{} {}\n{} {}\n", r.median_ms, std::max(most, 0.0), r.median_ms, 100 * r.mean_tpr());
        most = 100 * r.mean_tpr();
    }
    front += fmt::format("{} {}\n", times.high, most);
    return "$front << EOD\n" + front + "EOD\n" + scatter.script() +
           "set xlabel 'ms a frame of 555x555 lenslets, one thread'\nset ylabel 'found at 1e-3 false positives, mean of three families, %'\nset key bottom right\nset grid\n"
           "set title 'Time and detection: 9 bins, slope 0.15, 2000 photons'\n"
           "plot $front using 1:2 with lines lc rgb '#888888' title 'nothing is faster and finds more', " + Scatter::kPoints;
}

std::string error_script(const std::vector<Rated>& all) {
    const auto error = [](const Rated& r) { return std::max(r.error_of_threshold, 1e-3); };
    const double least = error(std::ranges::min(all, {}, error)), most = error(std::ranges::max(all, {}, error));
    Scatter scatter(times_of(all), {0.7 * least, 1.4 * most, true});
    for (const Rated& r : all) scatter.add(r.median_ms, error(r), r.name, r.kind);
    return scatter.script() +
           "set xlabel 'ms a frame of 555x555 lenslets, one thread'\nset ylabel 'error over threshold'\nset grid\nset key bottom right\n"
           "set title 'Error (RMS, against noise-free light) and time: 9 bins, slope 0.15, 2000 photons'\nplot " + Scatter::kPoints;
}

std::string pod_script(const TradeoffResults& results) {
    const Json& scores = *results.scores_at(kCentre);
    std::string script = "set multiplot layout 1,3\nset logscale x\nset yrange [0:1]\nset grid\nset ylabel 'probability of detection'\nset samples 400\n";
    for (std::size_t f = 0; f < kFamilies; ++f) {
        script += fmt::format("set title '{}'\nset xlabel '{}'\nset xrange [{}:{}]\n{}\nplot ", kFamilyNames[f], f == kFamilies - 1 ? "share of the light scattered" : "radius, lenslets",
                              kSmallest[f], kLargest[f], f == 0 ? "set key top left font ',9'" : "unset key");
        for (std::size_t k = 0; k < std::size(kShown); ++k) {
            const Json& curve = scores[kShown[k]][std::string(kFamilyNames[f])];
            script += fmt::format("{}1/(1+exp(-({})-({})*log(x))) with lines {} title '{}'", k == 0 ? "" : ", ", curve["b0"].get<double>(), curve["b1"].get<double>(), line_of(k), kShown[k]);
        }
        script += "\n";
    }
    return script + "unset multiplot\n";
}

struct PointAxis {
    std::string title, label;
    std::vector<std::pair<double, TradeoffPoint>> points;
    bool logarithmic = false;
};

// The points that differ from `base` in one member only.
template <class Member>
PointAxis axis_of(const TradeoffResults& results, TradeoffPoint base, Member TradeoffPoint::*member, const std::string& title, const std::string& label, bool logarithmic) {
    PointAxis axis{title, label, {}, logarithmic};
    for (const auto& cell : results.scores) {
        base.*member = cell.point.*member;
        if (cell.point == base) axis.points.emplace_back(static_cast<double>(cell.point.*member), cell.point);
    }
    std::ranges::sort(axis.points, {}, &std::pair<double, TradeoffPoint>::first);
    return axis;
}

// A panel an axis along which there are several points, and one for the key.
std::string axes_script(const TradeoffResults& results) {
    TradeoffPoint dim = kCentre;
    dim.photons = 200;
    const PointAxis axes[] = {axis_of(results, kCentre, &TradeoffPoint::slope, "slope of the part (2000 photons)", "bins over two lenslets", true),
                              axis_of(results, kCentre, &TradeoffPoint::photons, "light (slope 0.15)", "electrons a lenslet", true),
                              axis_of(results, kCentre, &TradeoffPoint::bins, "bins (slope 0.15, 2000 photons)", "bins a side", false),
                              axis_of(results, dim, &TradeoffPoint::frames, "frames averaged (slope 0.15, 200 photons each)", "frames", true),
                              axis_of(results, kCentre, &TradeoffPoint::stride, "stride (slope 0.15, 2000 photons)", "lenslets", false)};
    const auto style = [](std::size_t k) { return fmt::format("with linespoints pt {} {}", k + 1, line_of(k)); };
    std::string script = "set multiplot layout 2,3\nset grid\nset yrange [0:100]\nset ylabel 'found, mean of three families, %'\nunset key\n";
    int number = 0;
    for (const PointAxis& axis : axes) {
        if (axis.points.size() < 2) continue;
        script += fmt::format("$axis{} << EOD\n", number);
        for (const auto& [at, point] : axis.points) {
            const auto all = rated_at(results, point);
            script += fmt::format("{}", at);
            for (const char* name : kShown) script += fmt::format(" {}", 100 * named(all, name).mean_tpr());
            script += "\n";
        }
        script += fmt::format("EOD\n{}\nset title \"{}\"\nset xlabel '{}'\nplot ", axis.logarithmic ? "set logscale x" : "unset logscale x", axis.title, axis.label);
        for (std::size_t k = 0; k < std::size(kShown); ++k) script += fmt::format("{}$axis{} using 1:{} {} notitle", k == 0 ? "" : ", ", number, k + 2, style(k));
        script += "\n";
        ++number;
    }
    script += "unset title\nunset xlabel\nunset ylabel\nunset border\nunset tics\nunset grid\nunset logscale\nset key center center\nset xrange [0:1]\nplot ";
    for (std::size_t k = 0; k < std::size(kShown); ++k) script += fmt::format("{}NaN {} title '{}'", k == 0 ? "" : ", ", style(k), kShown[k]);
    return script + "\nunset multiplot\n";
}

}  // namespace

Result<std::vector<std::filesystem::path>> plot_tradeoff(const TradeoffResults& results, const std::filesystem::path& folder) {
    const auto centre = rated_at(results, kCentre);
    const struct {
        const char* name;
        std::string script;
        int width, height;
    } plots[] = {{"tradeoff-pareto", pareto_script(centre), kWidth, kHeight}, {"tradeoff-pod", pod_script(results), 1200, 480},
                 {"tradeoff-error", error_script(centre), kWidth, kHeight}, {"tradeoff-axes", axes_script(results), 1200, 720}};
    std::vector<std::filesystem::path> files;
    for (const auto& p : plots) {
        const auto drawn = plot(folder, p.name, p.script, p.width, p.height);
        if (!drawn) return tl::unexpected(drawn.error());
        files.insert(files.end(), drawn->begin(), drawn->end());
    }
    return files;
}

}  // namespace hord::firmware
