#include "lab/paper/paper_claims.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "lab/paper/paper_cameras.h"

namespace hord::lab {
namespace {

// The share of 360 directions from the centre in which the map is bright within four lenslets of the lens' edge.
double bright_share_of_rim(const SceneViews& clean, View view, const Interior& interior) {
    const algo::Extents& e = clean.scene.camera.extents;
    const double radius = sim::DoubleConvexLens{}.aperture_radius_mm / clean.scene.camera.field_mm * e.m;
    constexpr int kDirections = 360;
    int bright = 0;
    for (int d = 0; d < kDirections; ++d) {
        const double angle = 2 * std::numbers::pi * d / kDirections;
        bool found = false;
        for (double r = radius - 4; r <= radius + 4; r += 0.5) {
            const int m = static_cast<int>(std::lround(0.5 * (e.m - 1) + r * std::cos(angle)));
            const int n = static_cast<int>(std::lround(0.5 * (e.n - 1) + r * std::sin(angle)));
            found = found ||
                static_cast<double>(clean.map(view)[static_cast<std::size_t>(n * e.m + m)]) >= kVisible * interior.p99;
        }
        bright += found ? 1 : 0;
    }
    return static_cast<double>(bright) / kDirections;
}

// The ratio of a blob's size and the true one, at least 1. One size counts as closer if its ratio is smaller by 5 %.
double size_error(double blob, double truth) { return blob > 0 ? std::max(blob / truth, truth / blob) : 1e9; }
constexpr double kCloser = 1.05;

Claim both_at_once(const Figure& f) {
    const Contrast &cut = f.of(kBoth, View::telecentric, 0), &inclusion = f.of(kBoth, View::telecentric, 1),
                   &cut_emd = f.of(kBoth, View::emd, 0), &inclusion_emd = f.of(kBoth, View::emd, 1);
    return {
        fmt::format("In one picture: the telecentric camera sees the cut and not an inclusion of index {:g}, the EMD "
                    "sees both",
                    kInclusionIndex),
        cut.seen && !inclusion.seen && cut_emd.seen && inclusion_emd.seen,
        fmt::format("telecentric camera {:.1f} and {:.1f}, EMD {:.1f} and {:.1f} times the clean interior's 99th "
                    "percentile",
                    cut.ratio, inclusion.ratio, cut_emd.ratio, inclusion_emd.ratio)};
}

// The negative control. Light of one direction differs from place to place, so the outline of the lens is not found,
// and its rim is judged.
Claim plenoptic_control(const Figure& f) {
    const SceneViews &relay = f.scenes[kClean], &plenoptic = f.scenes[kPlenoptic];
    const auto told = [](const SceneViews& seen) {
        return fmt::format("{}; without asking for a whole part {}, score {:.2f}", name_of(seen.maps.verdict),
                           name_of(seen.unchecked_verdict), seen.unchecked_score);
    };
    return {
        fmt::format("A good lens passes before the 4f camera; before a plenoptic camera (main lens of {:g} mm at {:g} "
                    "mm) it is unfit, or rejected where no whole part is asked for",
                    kPlenopticFocalMm, kPlenopticDistanceMm),
        relay.maps.verdict == algo::Verdict::pass && relay.unchecked_verdict == algo::Verdict::pass &&
            plenoptic.maps.verdict == algo::Verdict::unfit && plenoptic.unchecked_verdict == algo::Verdict::reject,
        "4f: " + told(relay) + ". Plenoptic: " + told(plenoptic) + " (1 rejects)"};
}

}  // namespace

double information_of(const Figure& figure, SceneNumber scene, View view) {
    const SceneViews& seen = figure.scenes[scene];
    const TruthDefect& where = seen.truth.defects.at(0);
    const algo::Extents& e = seen.scene.camera.extents;
    const auto values = seen.map(view);
    const auto mask = seen.mask(view);
    constexpr int kNoValue = -1000, kSteps = 4, kLowest = -40;
    std::map<std::pair<int, bool>, double> joint;
    std::map<int, double> steps;
    double inside = 0, count = 0;
    const double reach = 2 * where.radius_lenslets + 8;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const double r = std::hypot(m - where.m, n - where.n);
            if (r > reach) continue;
            const auto k = static_cast<std::size_t>(n * e.m + m);
            const bool is_inside = r <= where.radius_lenslets;
            const double ratio = static_cast<double>(values[k]) / figure.clean(view).p99;
            const int step = (mask[k] & algo::kNoGradient) != 0 ? kNoValue
                : ratio > 0 ? std::max(kLowest, static_cast<int>(std::floor(kSteps * std::log2(ratio))))
                            : kLowest;
            joint[{step, is_inside}] += 1, steps[step] += 1, inside += is_inside ? 1 : 0, count += 1;
        }
    }
    double bits = 0;
    for (const auto& [key, number] : joint) {
        const double prior = (key.second ? inside : count - inside) / count;
        bits += number / count * std::log2(number / (steps[key.first] * prior));
    }
    return bits;
}

std::vector<Claim> claims_of_figure(const Figure& f, bool quick) {
    std::vector<Claim> claims;
    const auto ratio = [&](SceneNumber s, View v) { return fmt::format("{} {:.1f}", name_of(v), f.of(s, v).ratio); };
    const auto all_seen = [&](SceneNumber s, std::initializer_list<View> views) {
        return std::ranges::all_of(views, [&](View v) { return f.of(s, v).seen; });
    };
    const auto ratios = [&](SceneNumber s, std::initializer_list<View> views) {
        std::string text;
        for (const View v : views) text += (text.empty() ? "" : ", ") + ratio(s, v);
        return text + fmt::format(" times the clean interior's 99th percentile (seen: from {})", kVisible);
    };
    const double emd_rim = bright_share_of_rim(f.scenes[kClean], View::emd, f.clean(View::emd));
    const double frobenius_rim = bright_share_of_rim(f.scenes[kClean], View::frobenius, f.clean(View::frobenius));
    claims.push_back(
        {"The clean lens' rim is bright in the EMD gradient and in the Frobenius norm",
         emd_rim >= 0.95 && frobenius_rim >= 0.95,
         fmt::format("bright in {:.0f} % and {:.0f} % of all directions", 100 * emd_rim, 100 * frobenius_rim)});
    claims.push_back({"The cut is seen in EMD, Jacobian and transmission",
                      all_seen(kCut, {View::emd, View::frobenius, View::transmission}),
                      ratios(kCut, {View::emd, View::frobenius, View::transmission})});
    claims.push_back(
        {fmt::format("The cut is seen by the telecentric camera (area light of {:g} mm half width at 40 mm)",
                     kAreaLightMm),
         all_seen(kCut, {View::telecentric}), ratios(kCut, {View::telecentric})});
    claims.push_back({"The bubble is seen in EMD and Jacobian", all_seen(kBubble, {View::emd, View::frobenius}),
                      ratios(kBubble, {View::emd, View::frobenius})});
    claims.push_back({"The bubble is seen in EMD and Jacobian, dark lenslets taken as even",
                      all_seen(kBubble, {View::emd_even, View::frobenius_even}),
                      ratios(kBubble, {View::emd_even, View::frobenius_even})});
    claims.push_back({"The bubble of 0.5 mm is invisible to the telecentric camera (the same light)",
                      !f.of(kBubble, View::telecentric).seen, ratios(kBubble, {View::telecentric}), false});
    claims.push_back(both_at_once(f));
    for (const SceneNumber s : {kBubble, kCut}) {
        for (const bool closed : {false, true}) {
            const auto radius = [&](View view) {
                return closed ? f.of(s, view).closed_radius : f.of(s, view).blob_radius;
            };
            const double truth = f.true_radius(s), a = radius(View::emd), b = radius(View::frobenius);
            claims.push_back(
                {fmt::format("The {}'s blob is closer to its true size in the EMD than in the Frobenius norm{}",
                             f.scenes[s].scene.name, closed ? ", rings closed over dark lenslets" : ""),
                 kCloser * size_error(a, truth) < size_error(b, truth),
                 fmt::format("radius {:.1f} and {:.1f} lenslets, truth {:.1f}", a, b, truth),
                 quick && s == kBubble && !closed});  // true of coarse lenslets only
        }
    }
    const Contrast &cut_emd = f.of(kCut, View::emd), &cut_frobenius = f.of(kCut, View::frobenius);
    const std::string cut_numbers = fmt::format(
        "peak {:.1f} and {:.1f} times the clean interior's 99th percentile, contrast to noise {:.1f} and {:.1f}",
        cut_emd.ratio, cut_frobenius.ratio, cut_emd.to_noise, cut_frobenius.to_noise);
    claims.push_back({"The EMD responds to the cut more strongly than the Frobenius norm (peak, by 5 %)",
                      cut_emd.ratio > kCloser * cut_frobenius.ratio, cut_numbers, false});
    claims.push_back({"The EMD responds to the cut more strongly than the Frobenius norm (contrast to noise, by 5 %)",
                      cut_emd.to_noise > kCloser * cut_frobenius.to_noise, cut_numbers});
    double emd_bits = 0, frobenius_bits = 0;
    std::string bits;
    for (const SceneNumber s : {kCut, kBubble, kAbsorber}) {
        const double emd = information_of(f, s, View::emd), frobenius = information_of(f, s, View::frobenius);
        emd_bits += emd, frobenius_bits += frobenius;
        bits += fmt::format("{}{} {:.3f} and {:.3f}", bits.empty() ? "" : ", ", f.scenes[s].scene.name, emd, frobenius);
    }
    claims.push_back({"The EMD has slightly more information than the Frobenius norm on where the defects are",
                      emd_bits > frobenius_bits, bits + " bits a lenslet", false});
    claims.push_back(plenoptic_control(f));
    claims.push_back({"An absorber of 50 % stands out less in EMD and Jacobian than in the transmission",
                      std::max(f.of(kAbsorber, View::emd).ratio, f.of(kAbsorber, View::frobenius).ratio) <
                          f.of(kAbsorber, View::transmission).ratio,
                      ratios(kAbsorber, {View::emd, View::frobenius, View::transmission})});
    claims.push_back({"An absorber of 50 % is seen in the transmission and by the telecentric camera",
                      all_seen(kAbsorber, {View::transmission, View::telecentric}),
                      ratios(kAbsorber, {View::transmission, View::telecentric})});
    return claims;
}

}  // namespace hord::lab
