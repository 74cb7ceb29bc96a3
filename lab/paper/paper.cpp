#include "lab/paper/paper.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "firmware/diagnostics/map_files.h"
#include "lab/experiment/scenes.h"
#include "lab/paper/paper_cameras.h"
#include "lab/paper/paper_claims.h"
#include "lab/paper/paper_pitch.h"
#include "lab/paper/paper_vary.h"
#include "lab/paper/paper_views.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {

using namespace firmware;
namespace {

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
    scenes[kBoth].name = "cut-and-inclusion";
    scenes[kBoth].defects = {cut_of_lens(1.0), sim::Inclusion{{0, 0, 0}, 0.5, kInclusionIndex}};
    scenes[kPlenoptic].name = "plenoptic";
    scenes[kPlenoptic].camera.main_lens = {kPlenopticFocalMm, kPlenopticDistanceMm};
    for (auto& scene : scenes) scene.seed = seed, scene.telecentric.panel_half_mm = kAreaLightMm;
    return scenes;
}

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
        for (std::size_t s = kCut; s < kPlenoptic; ++s) {
            const SceneViews& seen = figure.scenes[s];
            if (seen.truth.defects.size() != seen.scene.defects.size()) {
                return fail(ErrorCode::internal, "a defect of scene " + seen.scene.name + " is not in sight",
                            "report this");
            }
            for (const TruthDefect& defect : seen.truth.defects)
                figure.contrast[s][v].push_back(contrast_of(seen.signal(view), seen.mask(view),
                                                            seen.scene.camera.extents, defect, figure.interior[v],
                                                            floor_of(view)));
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
        std::string label = seen.scene.name;  // one word a line
        std::ranges::replace(label, '-', ' ');
        MontageRow row{label, {}}, close{label, {}};
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
            if (static_cast<std::size_t>(view) < kViewsOfFigure)
                row.pictures.push_back(picture_of_figure(seen, view, high(view)));
            if (seen.truth.defects.empty() || view == View::frobenius_even) continue;
            const TruthDefect& defect = seen.truth.defects.back();
            const int side = std::min(static_cast<int>(4 * defect.radius_lenslets) | 1, seen.scene.camera.extents.m);
            close.pictures.push_back(close_picture_of(seen, view, high(view), defect.m, defect.n, std::max(side, 21)));
        }
        figure_rows.push_back(std::move(row));
        if (!seen.truth.defects.empty()) close_rows.push_back(std::move(close));
    }
    for (const auto& [name, rows] : {std::pair("paper.png", &figure_rows), std::pair("paper-close.png", &close_rows)}) {
        if (auto done = write_png(out / name, halved(montage(*rows, kLettersOfFigure))); !done) return done;
        report.files.push_back(out / name);
    }
    return {};
}

Table contrast_table(const Figure& figure) {
    Table table{{"scene", "seen by", "clean p99", "peak", "peak / clean p99", "contrast to noise",
                 "blob radius, lenslets", "rings closed", "true radius, lenslets", "seen"},
                {}};
    for (const SceneNumber s : {kCut, kBubble, kAbsorber}) {
        for (const View view : kAllViews) {
            const Contrast& c = figure.of(s, view);
            table.rows.push_back({figure.scenes[s].scene.name, std::string(name_of(view)),
                                  fmt::format("{:.4f}", figure.clean(view).p99), fmt::format("{:.3f}", c.peak),
                                  fmt::format("{:.1f}", c.ratio), fmt::format("{:.1f}", c.to_noise),
                                  c.seen ? fmt::format("{:.1f}", c.blob_radius) : "-",
                                  c.seen ? fmt::format("{:.1f}", c.closed_radius) : "-",
                                  fmt::format("{:.1f}", figure.true_radius(s)), c.seen ? "yes" : "no"});
        }
    }
    return table;
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
                          {{"experiment", "paper"}, {"quick", options.quick}, {"seed", options.seed}, {"form", 2}});
    if (!cells) return tl::unexpected(cells.error());
    constexpr double kShareOfFigure = 0.6;
    const auto figure = inspect_figure(options, lenslets, *cells, kShareOfFigure);
    if (!figure) return tl::unexpected(figure.error());

    ExperimentReport report;
    report.claims = claims_of_figure(*figure, options.quick);
    if (auto done = write_pictures(options.out, *figure, report); !done) return tl::unexpected(done.error());
    const Table table = contrast_table(*figure);
    if (auto done = write_csv(options.out / "contrast.csv", table); !done) return tl::unexpected(done.error());
    report.files.push_back(options.out / "contrast.csv");

    ExperimentOptions rest = options;
    rest.progress = [&](double done, const std::string& note) { options.progress(kShareOfFigure + 0.1 * done, note); };
    const auto pitches = vary_pitch(rest, lens_scene(lenslets), *cells);
    if (!pitches) return tl::unexpected(pitches.error());
    const auto cameras = compare_cameras(rest, *cells);
    if (!cameras) return tl::unexpected(cameras.error());
    for (const auto& part : {*cameras, *pitches}) {
        report.claims.insert(report.claims.end(), part.claims.begin(), part.claims.end());
        report.files.insert(report.files.end(), part.files.begin(), part.files.end());
    }
    rest.progress = [&](double done, const std::string& note) {
        options.progress(kShareOfFigure + 0.1 + (0.9 - kShareOfFigure) * done, note);
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
                               {"pitches", pitches->text},
                               {"area_light_mm", fmt::format("{:g}", kAreaLightMm)},
                               {"inclusion_index", fmt::format("{:g}", kInclusionIndex)},
                               {"focal_mm", fmt::format("{:g}", kPlenopticFocalMm)},
                               {"distance_mm", fmt::format("{:g}", kPlenopticDistanceMm)},
                               {"hashes", hashes_of(*figure)}});
    options.progress(1, "");
    return report;
}

}  // namespace hord::lab
