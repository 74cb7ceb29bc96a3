#include "lab/detection/detection_plots.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include <fmt/format.h>

#include "lab/detection/detection_statistics.h"

namespace hord::lab {

std::string roc_script(const DetectionResults& r) {
    constexpr std::array figures = {"speck", "haze", "dimple", "scratch", "bubble"};
    std::string script, plots;
    const Parts& good = parts_of(r, "wobble");
    for (std::size_t f = 0; f < figures.size(); ++f) {
        if (parts_of(r, figures[f]).empty()) continue;
        std::vector<double> limits;
        for (const JudgedPart& p : good) limits.push_back(p.score);
        for (const JudgedPart& p : parts_of(r, figures[f])) limits.push_back(p.score);
        std::ranges::sort(limits, std::greater<>());
        script += fmt::format("$roc{} << EOD\n", f);
        for (std::size_t k = 0; k < limits.size(); k += std::max<std::size_t>(1, limits.size() / 400)) {
            script += fmt::format("{} {}\n", std::max(share_above(good, limits[k]), 2e-4),
                                  share_above(parts_of(r, figures[f]), limits[k]));
        }
        script += "EOD\n";
        plots += fmt::format("{}$roc{} using 1:2 with lines lw 2 title '{}'", plots.empty() ? "" : ", ", f, figures[f]);
    }
    return script +
        "set logscale x\nset xrange [2e-4:1]\nset yrange [0:1]\nset grid\nset key bottom right\nset xlabel 'good parts "
        "rejected (2e-4: none of them)'\n"
        "set ylabel 'flawed parts rejected'\nset title 'ROC, parts that wobble'\nplot " +
        plots + "\n";
}

std::string pod_script(const DetectionResults& r) {
    const Parts& bubbles = parts_of(r, "bubble");
    const PodCurve all = pod_of(bubbles, r.bubble_exposures, 0);
    std::string script = "$bins << EOD\n";
    constexpr int kBins = 14;
    for (int b = 0; b < kBins; ++b) {
        const double low = 0.1 * std::pow(15.0, static_cast<double>(b) / kBins),
                     high = 0.1 * std::pow(15.0, (b + 1.0) / kBins);
        double n = 0, found = 0;
        for (const JudgedPart& p : bubbles) {
            if (p.size < low || p.size >= high) continue;
            n += 1, found += p.score >= 1 && p.hit ? 1 : 0;
        }
        if (n == 0) continue;
        const Estimate share = share_of(found, n);
        script += fmt::format("{} {} {} {}\n", std::sqrt(low * high), share.value, share.low, share.high);
    }
    return script +
        fmt::format(
               "EOD\nset logscale x\nset xrange [0.1:1.5]\nset yrange [0:1]\nset samples 400\nset grid\nset key top "
               "left\nset xlabel 'radius of the bubble, lenslets'\n"
               "set ylabel 'probability of detection'\nset title \"Bubbles found, at {} limits\"\n"
               "plot $bins using 1:2:3:4 with yerrorbars pt 7 title 'found (95 %)', 1/(1+exp(-({})-({})*log(x))) with "
               "lines lw 2 title 'logistic'\n",
               r.tuned_on > 0 ? "tuned" : "the recipe's", all.b0, all.b1);
}

std::string slope_script(const std::string& points) {
    return "$auc << EOD\n" + points +
        "EOD\nset logscale x\nset xrange [0.04:2]\nset yrange [*:1.0005]\nset grid\nunset key\nset xlabel 'slope of "
        "the part, bins over two lenslets'\nset ylabel 'AUC'\n"
        "set title 'Haze of a tenth of the light, 2,000 electrons a lenslet'\nplot $auc using 1:2:3:4 with yerrorlines "
        "lw 2 pt 7\n";
}

}  // namespace hord::lab
