#include "lab/paper/paper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "lab/experiment/scenes.h"
#include "lab/paper/paper_vary.h"
#include "lab/paper/paper_views.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {

using namespace firmware;
namespace {

constexpr double kAbsorberTransmission = 0.5;
constexpr std::array<View, kViews> kAllViews = {View::emd,         View::frobenius, View::transmission,
                                                View::telecentric, View::emd_even,  View::frobenius_even};
enum SceneNumber : std::size_t { kClean, kCut, kBubble, kAbsorber, kScenes };

std::array<sim::Scene, kScenes> scenes_of_figure(int lenslets, std::uint64_t seed) {
    std::array<sim::Scene, kScenes> scenes;
    scenes.fill(lens_scene(lenslets));
    scenes[kClean].name = "clean";
    scenes[kCut].name = "cut";
    scenes[kCut].defects = {cut_of_lens(1.0)};
    scenes[kBubble].name = "bubble";
    scenes[kBubble].defects = {bubble_of_lens(0.5)};
    scenes[kAbsorber].name = "absorber";
    scenes[kAbsorber].defects = {absorber_of_lens(kAbsorberTransmission)};
    for (auto& scene : scenes) scene.seed = seed;
    return scenes;
}

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

struct Figure {
    std::vector<SceneViews> scenes;
    std::array<Interior, kViews> interior;
    std::array<std::array<Contrast, kViews>, kScenes> contrast;  // kClean: unused

    [[nodiscard]] const Contrast& of(SceneNumber scene, View view) const {
        return contrast[scene][static_cast<std::size_t>(view)];
    }
    [[nodiscard]] const Interior& clean(View view) const { return interior[static_cast<std::size_t>(view)]; }
    [[nodiscard]] double true_radius(SceneNumber scene) const {
        return scenes[scene].truth.defects.at(0).radius_lenslets;
    }
};

Result<Figure> inspect_figure(const ExperimentOptions& options, int lenslets, ResultCache& cells,
                              double share_of_work) {
    Figure figure;
    const auto scenes = scenes_of_figure(lenslets, options.seed);
    for (std::size_t s = 0; s < kScenes; ++s) {
        const auto progress = [&](double done) {
            options.progress(share_of_work * (static_cast<double>(s) + done) / static_cast<double>(scenes.size()),
                             "rendering " + scenes[s].name);
        };
        auto views = inspect_scene(scenes[s], options.out, options.threads, cells, progress);
        if (!views) return tl::unexpected(views.error());
        figure.scenes.push_back(std::move(*views));
    }
    for (std::size_t v = 0; v < kViews; ++v) {
        const View view = kAllViews[v];
        figure.interior[v] = interior_of(figure.scenes[kClean].signal(view), figure.scenes[kClean].mask(view));
        for (std::size_t s = kCut; s < kScenes; ++s) {
            const SceneViews& seen = figure.scenes[s];
            if (seen.truth.defects.empty())
                return fail(ErrorCode::internal, "scene " + seen.scene.name + " has no defect in sight", "report this");
            figure.contrast[s][v] = contrast_of(seen.signal(view), seen.mask(view), seen.scene.camera.extents,
                                                seen.truth.defects[0], figure.interior[v], floor_of(view));
        }
    }
    return figure;
}

Result<void> write_pictures(const std::filesystem::path& out, const Figure& figure, ExperimentReport& report) {
    const float emd_high = static_cast<float>(6 * figure.clean(View::emd).p99),
                frobenius_high = static_cast<float>(6 * figure.clean(View::frobenius).p99);
    const auto high = [&](View view) {
        return view == View::emd || view == View::emd_even            ? emd_high
            : view == View::frobenius || view == View::frobenius_even ? frobenius_high
                                                                      : 1.2F;
    };
    std::vector<MontageRow> figure_rows, close_rows;
    for (std::size_t s = 0; s < kScenes; ++s) {
        const SceneViews& seen = figure.scenes[s];
        MontageRow row{seen.scene.name, {}}, close{seen.scene.name, {}};
        for (const View view : kAllViews) {
            const std::string name = fmt::format("{}.{}", seen.scene.name, file_name_of(view));
            const Picture picture =
                picture_of(seen, view, fmt::format("{}: {}", seen.scene.name, name_of(view)), high(view));
            if (auto done = write_png(out / (name + ".png"), picture); !done) return done;
            const auto values = with_no_data(seen.map(view), seen.mask(view), algo::kNoGradient);
            if (auto done = write_float_tiff(out / (name + ".tiff"), values, seen.scene.camera.extents); !done)
                return done;
            report.files.push_back(out / (name + ".png"));
            report.files.push_back(out / (name + ".tiff"));
            if (static_cast<std::size_t>(view) < kViewsOfFigure) row.pictures.push_back(picture);
            if (s == kClean || view == View::frobenius_even) continue;
            const TruthDefect& defect = seen.truth.defects[0];
            const int side = std::min(static_cast<int>(4 * defect.radius_lenslets) | 1, seen.scene.camera.extents.m);
            close.pictures.push_back(close_picture_of(seen, view, std::string(name_of(view)), high(view), defect.m,
                                                      defect.n, std::max(side, 21)));
        }
        figure_rows.push_back(std::move(row));
        if (s != kClean) close_rows.push_back(std::move(close));
    }
    for (const auto& [name, rows] : {std::pair("paper.png", &figure_rows), std::pair("paper-close.png", &close_rows)}) {
        if (auto done = write_png(out / name, halved(montage(*rows))); !done) return done;
        report.files.push_back(out / name);
    }
    return {};
}

Table contrast_table(const Figure& figure) {
    Table table{{"scene", "seen by", "clean p99", "peak", "peak / clean p99", "contrast to noise",
                 "blob radius, lenslets", "true radius, lenslets", "seen"},
                {}};
    for (const SceneNumber s : {kCut, kBubble, kAbsorber}) {
        for (const View view : kAllViews) {
            const Contrast& c = figure.of(s, view);
            table.rows.push_back({figure.scenes[s].scene.name, std::string(name_of(view)),
                                  fmt::format("{:.4f}", figure.clean(view).p99), fmt::format("{:.3f}", c.peak),
                                  fmt::format("{:.1f}", c.ratio), fmt::format("{:.1f}", c.to_noise),
                                  c.seen ? fmt::format("{:.1f}", c.blob_radius) : "-",
                                  fmt::format("{:.1f}", figure.true_radius(s)), c.seen ? "yes" : "no"});
        }
    }
    return table;
}

// The ratio of a blob's size and the true one, at least 1. One size counts as closer if its ratio is smaller by 5 %.
double size_error(double blob, double truth) { return blob > 0 ? std::max(blob / truth, truth / blob) : 1e9; }
constexpr double kCloser = 1.05;

std::vector<Claim> claims_of(const Figure& f, bool quick) {
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
    claims.push_back({"The cut is seen by the telecentric camera (area light of 60 mm half width at 40 mm)",
                      all_seen(kCut, {View::telecentric}), ratios(kCut, {View::telecentric}), false});
    claims.push_back({"The bubble is seen in EMD and Jacobian", all_seen(kBubble, {View::emd, View::frobenius}),
                      ratios(kBubble, {View::emd, View::frobenius})});
    claims.push_back({"The bubble is seen in EMD and Jacobian, dark lenslets taken as even",
                      all_seen(kBubble, {View::emd_even, View::frobenius_even}),
                      ratios(kBubble, {View::emd_even, View::frobenius_even})});
    claims.push_back({"The bubble of 0.5 mm is invisible to the telecentric camera (the same light)",
                      !f.of(kBubble, View::telecentric).seen, ratios(kBubble, {View::telecentric}), false});
    for (const SceneNumber s : {kBubble, kCut}) {
        for (const auto& [emd, frobenius] :
             {std::pair(View::emd, View::frobenius), std::pair(View::emd_even, View::frobenius_even)}) {
            const double truth = f.true_radius(s), a = f.of(s, emd).blob_radius, b = f.of(s, frobenius).blob_radius;
            claims.push_back(
                {fmt::format("The {}'s blob is closer to its true size in the EMD than in the Frobenius norm{}",
                             f.scenes[s].scene.name, emd == View::emd ? "" : ", dark lenslets taken as even"),
                 kCloser * size_error(a, truth) < size_error(b, truth),
                 fmt::format("radius {:.1f} and {:.1f} lenslets, truth {:.1f}", a, b, truth),
                 quick && s == kBubble});  // true of coarse lenslets only
        }
    }
    claims.push_back({"An absorber of 50 % stands out less in EMD and Jacobian than in the transmission",
                      std::max(f.of(kAbsorber, View::emd).ratio, f.of(kAbsorber, View::frobenius).ratio) <
                          f.of(kAbsorber, View::transmission).ratio,
                      ratios(kAbsorber, {View::emd, View::frobenius, View::transmission})});
    claims.push_back({"An absorber of 50 % is seen in the transmission and by the telecentric camera",
                      all_seen(kAbsorber, {View::transmission, View::telecentric}),
                      ratios(kAbsorber, {View::transmission, View::telecentric})});
    return claims;
}

std::string hashes_of(const Figure& figure) {
    Table table{{"scene", "frame", "EMD", "Frobenius", "transmission", "telecentric"}, {}};
    for (const SceneViews& seen : figure.scenes) {
        table.rows.push_back({seen.scene.name, seen.frame_hash, hash_of(seen.maps.emd), hash_of(seen.maps.frobenius),
                              hash_of(seen.maps.transmission), hash_of(seen.telecentric)});
    }
    return to_markdown(table);
}

}  // namespace

Result<ExperimentReport> run_paper(const ExperimentOptions& options) {
    const int lenslets = options.quick ? 231 : 555;
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "paper"}, {"quick", options.quick}, {"seed", options.seed}, {"form", 1}});
    if (!cells) return tl::unexpected(cells.error());
    constexpr double kShareOfFigure = 0.6;
    const auto figure = inspect_figure(options, lenslets, *cells, kShareOfFigure);
    if (!figure) return tl::unexpected(figure.error());

    ExperimentReport report;
    report.claims = claims_of(*figure, options.quick);
    if (auto done = write_pictures(options.out, *figure, report); !done) return tl::unexpected(done.error());
    const Table table = contrast_table(*figure);
    if (auto done = write_csv(options.out / "contrast.csv", table); !done) return tl::unexpected(done.error());
    report.files.push_back(options.out / "contrast.csv");

    ExperimentOptions rest = options;
    rest.progress = [&](double done, const std::string& note) {
        options.progress(kShareOfFigure + (1 - kShareOfFigure) * done, note);
    };
    const auto varied =
        vary_paper(rest, lens_scene(lenslets), figure->clean(View::emd), figure->clean(View::frobenius), *cells);
    if (!varied) return tl::unexpected(varied.error());
    report.claims.insert(report.claims.end(), varied->claims.begin(), varied->claims.end());
    report.files.insert(report.files.end(), varied->files.begin(), varied->files.end());

    const sim::Scene& scene = figure->scenes[kClean].scene;
    report.text = fill_report("paper",
                              {{"quick", options.quick ? "yes" : ""},
                               {"seed", std::to_string(options.seed)},
                               {"field_mm", fmt::format("{}", scene.camera.field_mm)},
                               {"lenslets", std::to_string(lenslets)},
                               {"pitch_um", fmt::format("{:.1f}", 1000 * scene.camera.field_mm / lenslets)},
                               {"source_radius_bins", fmt::format("{}", scene.light.source_radius_bins)},
                               {"claims", describe(report.claims)},
                               {"visible", fmt::format("{}", kVisible)},
                               {"contrasts", to_markdown(table)},
                               {"panel_distance_mm", fmt::format("{:g}", scene.telecentric.panel_distance_mm)},
                               {"varied", varied->text},
                               {"hashes", hashes_of(*figure)}});
    options.progress(1, "");
    return report;
}

}  // namespace hord::lab
