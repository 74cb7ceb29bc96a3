#include "lab/tradeoff/tradeoff_plots.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

#include "lab/report/scatter.h"
#include "lab/report/tables.h"
#include "lab/tradeoff/tradeoff_rating.h"

namespace hord::lab {
namespace {

constexpr int kWidth = Scatter::kWidth, kHeight = Scatter::kHeight;
constexpr const char* kPoints =
    "$points using ($3==0?$1:1/0):2 with points pt 9 ps 1.4 lc rgb '#2ca02c' title 'the light alone', "
    "$points using ($3==1?$1:1/0):2 with points pt 7 lc rgb '#1f77b4' title 'over neighbours', "
    "$points using ($3==2?$1:1/0):2 with points pt 5 lc rgb '#d62728' title 'against a reference'\n";

// Colours and dashes of kShown, in its order: against a reference dashed.
std::string line_of(std::size_t shown) {
    constexpr const char* kColours[] = {"#1f77b4", "#9467bd", "#17becf", "#8c564b",
                                        "#2ca02c", "#1f77b4", "#d62728", "#ff7f0e"};
    return fmt::format("lw 2 lc rgb '{}' {}", kColours[shown],
                       std::string_view(kShown[shown]).starts_with("reference") ? "dt 2" : "dt 1");
}

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
        scatter.add(r.median_ms, 100 * r.mean_tpr(), r.name, static_cast<int>(r.kind));
        if (100 * r.mean_tpr() <= most) continue;
        front += fmt::format("{} {}\n{} {}\n", r.median_ms, std::max(most, 0.0), r.median_ms, 100 * r.mean_tpr());
        most = 100 * r.mean_tpr();
    }
    front += fmt::format("{} {}\n", times.high, most);
    return "$front << EOD\n" + front + "EOD\n" + scatter.script() +
        "set xlabel 'ms a frame of 555x555 lenslets, one thread'\nset ylabel 'found at 1e-3 false positives, mean of "
        "three families, %'\nset grid\n"
        "set title 'Time and detection: 9 bins, slope 0.15, 2000 photons'\n"
        "plot $front using 1:2 with lines lc rgb '#888888' title 'nothing is faster and finds more', " +
        kPoints;
}

std::string error_script(const std::vector<Rated>& all) {
    const auto error = [](const Rated& r) { return std::max(r.error_of_threshold, 1e-3); };
    const double least = error(std::ranges::min(all, {}, error)), most = error(std::ranges::max(all, {}, error));
    Scatter scatter(times_of(all), {0.7 * least, 1.4 * most, true});
    for (const Rated& r : all) scatter.add(r.median_ms, error(r), r.name, static_cast<int>(r.kind));
    return scatter.script() +
        "set xlabel 'ms a frame of 555x555 lenslets, one thread'\nset ylabel 'error over threshold'\nset grid\n"
        "set title 'Error (RMS, against noise-free light) and time: 9 bins, slope 0.15, 2000 photons'\nplot " +
        kPoints;
}

std::string pod_script(const TradeoffResults& results) {
    const Json& scores = *results.scores_at(kCentre);
    std::string script =
        "set multiplot layout 1,3\nset logscale x\nset yrange [0:1]\nset grid\nset ylabel 'probability of "
        "detection'\nset samples 400\n";
    for (std::size_t f = 0; f < kFamilies; ++f) {
        script += fmt::format("set title '{}'\nset xlabel '{}'\nset xrange [{}:{}]\n{}\nplot ", kFamilyNames[f],
                              f == kFamilies - 1 ? "share of the light scattered" : "radius, lenslets", kSmallest[f],
                              kLargest[f], f == 0 ? "set key top left font ',9'" : "unset key");
        for (std::size_t k = 0; k < std::size(kShown); ++k) {
            const Json& curve = scores[kShown[k]][std::string(kFamilyNames[f])];
            script += fmt::format("{}1/(1+exp(-({})-({})*log(x))) with lines {} title '{}'", k == 0 ? "" : ", ",
                                  curve["b0"].get<double>(), curve["b1"].get<double>(), line_of(k), kShown[k]);
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
PointAxis axis_of(const TradeoffResults& results, TradeoffPoint base, Member TradeoffPoint::*member,
                  const std::string& title, const std::string& label, bool logarithmic) {
    PointAxis axis{title, label, {}, logarithmic};
    for (const auto& cell : results.scores) {
        base.*member = cell.point.*member;
        if (cell.point == base) axis.points.emplace_back(static_cast<double>(cell.point.*member), cell.point);
    }
    std::ranges::sort(axis.points, {}, &std::pair<double, TradeoffPoint>::first);
    return axis;
}

// One panel for each axis with several points, and one for the key.
std::string axes_script(const TradeoffResults& results) {
    TradeoffPoint dim = kCentre;
    dim.photons = 200;
    const PointAxis axes[] = {
        axis_of(results, kCentre, &TradeoffPoint::slope, "slope of the part (2000 photons)", "bins over two lenslets",
                true),
        axis_of(results, kCentre, &TradeoffPoint::photons, "light (slope 0.15)", "electrons a lenslet", true),
        axis_of(results, kCentre, &TradeoffPoint::bins, "bins (slope 0.15, 2000 photons)", "bins a side", false),
        axis_of(results, dim, &TradeoffPoint::frames, "frames averaged (slope 0.15, 200 photons each)", "frames", true),
        axis_of(results, kCentre, &TradeoffPoint::stride, "stride (slope 0.15, 2000 photons)", "lenslets", false)};
    const auto style = [](std::size_t k) { return fmt::format("with linespoints pt {} {}", k + 1, line_of(k)); };
    std::string script =
        "set multiplot layout 2,3\nset grid\nset yrange [0:100]\nset ylabel 'found, mean of three families, %'\nunset "
        "key\n";
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
        script += fmt::format("EOD\n{}\nset title \"{}\"\nset xlabel '{}'\nplot ",
                              axis.logarithmic ? "set logscale x" : "unset logscale x", axis.title, axis.label);
        for (std::size_t k = 0; k < std::size(kShown); ++k)
            script += fmt::format("{}$axis{} using 1:{} {} notitle", k == 0 ? "" : ", ", number, k + 2, style(k));
        script += "\n";
        ++number;
    }
    script +=
        "unset title\nunset xlabel\nunset ylabel\nunset border\nunset tics\nunset grid\nunset logscale\nset key center "
        "center\nset xrange [0:1]\nplot ";
    for (std::size_t k = 0; k < std::size(kShown); ++k)
        script += fmt::format("{}NaN {} title '{}'", k == 0 ? "" : ", ", style(k), kShown[k]);
    return script + "\nunset multiplot\n";
}

}  // namespace

Result<std::vector<std::filesystem::path>> plot_tradeoff(const TradeoffResults& results,
                                                         const std::filesystem::path& folder) {
    const auto centre = rated_at(results, kCentre);
    const struct {
        const char* name;
        std::string script;
        int width, height;
    } plots[] = {{"tradeoff-pareto", pareto_script(centre), kWidth, kHeight},
                 {"tradeoff-pod", pod_script(results), 1200, 480},
                 {"tradeoff-error", error_script(centre), kWidth, kHeight},
                 {"tradeoff-axes", axes_script(results), 1200, 720}};
    std::vector<std::filesystem::path> files;
    for (const auto& p : plots) {
        const auto drawn = plot(folder, p.name, p.script, p.width, p.height);
        if (!drawn) return tl::unexpected(drawn.error());
        files.insert(files.end(), drawn->begin(), drawn->end());
    }
    return files;
}

}  // namespace hord::lab
