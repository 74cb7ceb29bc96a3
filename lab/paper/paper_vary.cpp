#include "lab/paper/paper_vary.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/recipe/recipe.h"
#include "hal_sim/optics/camera/telecentric.h"
#include "lab/experiment/scenes.h"
#include "lab/optics/truth.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

constexpr double kFloor = 0.01;  // of the light: as paper_views.h

struct Defect {
    std::string key, name;
    sim::Scene scene;  // close up
    enum class Kind { cut, bubble, inclusion } kind;
};

std::vector<Defect> defects_of(const sim::Scene& lens, bool quick) {
    std::vector<Defect> defects;
    const double pitch = lens.camera.field_mm / lens.camera.extents.m;
    const auto add = [&](Defect::Kind kind, const std::string& name, const sim::SceneDefect& defect, double at,
                         double reach) {
        sim::Scene scene = close_up(lens, at, at, 2 * static_cast<int>(std::ceil(reach / pitch)) + 31);
        scene.name = name;
        scene.defects = {defect};
        // 32: fine enough for a bubble of a twentieth of a pixel.
        scene.telecentric.rays_per_side = kind == Defect::Kind::cut || quick ? 6 : 32;
        defects.push_back({"vary " + name, name, scene, kind});
    };
    for (const double depth : {1.0, 0.1, 0.01, 0.001}) {
        if (quick && depth != 1.0) continue;
        const auto cut = cut_of_lens(depth);
        add(Defect::Kind::cut, fmt::format("cut, {:g} mm deep", depth), cut, cut.centre_mm.x,
            std::sqrt(2 * cut.radius_mm * depth - depth * depth));
    }
    for (const double radius : {0.5, 0.25, 0.12, 0.06, 0.03, 0.015, 0.008, 0.004, 0.002}) {
        if (quick && radius != 0.5 && radius != 0.06) continue;
        add(Defect::Kind::bubble, fmt::format("bubble, {:g} mm", radius), bubble_of_lens(radius), 0, radius);
    }
    for (const double radius : {0.5, 0.12, 0.03}) {
        if (quick && radius != 0.5) continue;
        add(Defect::Kind::inclusion, fmt::format("inclusion of index 1.52, {:g} mm", radius),
            sim::Inclusion{{0, 0, 0}, radius, 1.52}, 0, radius);
    }
    return defects;
}

std::vector<double> panels(bool quick) {
    return quick ? std::vector<double>{60, 30, 8} : std::vector<double>{240, 120, 60, 30, 15, 8, 4};
}

// Relative deviation of the light of every lenslet from the median of the close-up. The part fills the close-up.
std::vector<float> light_signal(std::vector<float> light) {
    std::vector<float> sorted = light;
    std::ranges::sort(sorted);
    const float usual = sorted[sorted.size() / 2];
    for (float& v : light) v = std::abs(v / usual - 1);
    return light;
}
std::vector<float> sums_of(const Frame& frame, const algo::Extents& e) {
    std::vector<float> sums(e.lenslets());
    const auto view = frame.view();
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            sums[static_cast<std::size_t>(y / e.j * e.m + x / e.i)] +=
                static_cast<float>(std::max(view.sample(x, y), algo::kDarkDn8Bit) - algo::kDarkDn8Bit);
        }
    }
    return sums;
}

// Lenslets within three of the defect whose EMD or Frobenius norm changes by more than the clean interior's 99th
// percentile when the scene moves by a thousandth of a lenslet: noise of the tracer's sampling, not of the light.
Result<int> noisy_lenslets(const Defect& defect, const InspectedMaps& maps, const TruthDefect& where,
                           const Interior& emd, const Interior& frobenius, int threads) {
    sim::Scene moved = defect.scene;
    const algo::Extents& e = moved.camera.extents;
    moved.pose.x_mm += 1e-3 * moved.camera.field_mm / e.m;
    const auto light = sim::render(moved, {threads, {}});
    if (!light) return tl::unexpected(light.error());
    const auto other = inspect_frame(sim::expose(*light, moved, moved.seed), e, 1);
    if (!other) return tl::unexpected(other.error());
    const auto differs = [](float a, float b, const Interior& clean) {
        return std::abs(static_cast<double>(a) - static_cast<double>(b)) > clean.p99;
    };
    int noisy = 0;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto k = static_cast<std::size_t>(n * e.m + m);
            if (std::hypot(m - where.m, n - where.n) > where.radius_lenslets + 3 ||
                ((maps.mask[k] | other->mask[k]) & algo::kNoGradient) != 0)
                continue;
            noisy +=
                differs(maps.emd[k], other->emd[k], emd) || differs(maps.frobenius[k], other->frobenius[k], frobenius);
        }
    }
    return noisy;
}

Json to_json(const Contrast& c) {
    return {{"ratio", c.ratio}, {"to_noise", c.to_noise}, {"blob", c.blob_radius}, {"seen", c.seen}};
}

std::string panel_key(double half) { return fmt::format("panel {}", half); }

Result<Json> measure_defect(const Defect& defect, const std::vector<double>& panel_halves, const Interior& emd,
                            const Interior& frobenius, int threads) {
    const algo::Extents& e = defect.scene.camera.extents;
    const auto truth = truth_of(defect.scene);
    if (truth.defects.empty()) return fail(ErrorCode::internal, defect.name + " is not in sight", "report this");
    const TruthDefect& where = truth.defects[0];
    const auto light = sim::render(defect.scene, {threads, {}});
    if (!light) return tl::unexpected(light.error());
    const Frame frame = sim::expose(*light, defect.scene, defect.scene.seed);
    const auto maps = inspect_frame(frame, e, 1);
    if (!maps) return tl::unexpected(maps.error());
    const auto even = inspect_frame(with_dark_as_uniform(frame, *maps), e, 1);
    if (!even) return tl::unexpected(even.error());
    const std::vector<std::uint8_t> all_valid(e.lenslets(), algo::kValid);
    const Interior flat{};  // the light of a clean part is uniform: the floor decides
    const auto noisy = noisy_lenslets(defect, *maps, where, emd, frobenius, threads);
    if (!noisy) return tl::unexpected(noisy.error());
    Json found{
        {"radius", where.radius_lenslets},
        {"noisy", *noisy},
        {"emd", to_json(contrast_of(maps->emd, maps->mask, e, where, emd, 0))},
        {"emd-even", to_json(contrast_of(even->emd, even->mask, e, where, emd, 0))},
        {"frobenius", to_json(contrast_of(maps->frobenius, maps->mask, e, where, frobenius, 0))},
        {"transmission", to_json(contrast_of(light_signal(sums_of(frame, e)), all_valid, e, where, flat, kFloor))}};
    for (const double half : panel_halves) {
        sim::Scene scene = defect.scene;
        scene.telecentric.panel_half_mm = half;
        const auto picture = render_telecentric(scene, {threads, {}});
        if (!picture) return tl::unexpected(picture.error());
        found[panel_key(half)] = to_json(contrast_of(light_signal(picture->light), all_valid, e, where, flat, kFloor));
    }
    return found;
}

std::string cell_text(const Json& contrast) {
    const double ratio = contrast["ratio"].get<double>();
    const std::string text = ratio < 9.95 ? fmt::format("{:.1f}", ratio) : fmt::format("{:.0f}", ratio);
    return contrast["seen"].get<bool>() ? "**" + text + "**" : text;
}

// A row a defect: its contrast to each of the cameras.
Table contrasts(const std::vector<Defect>& defects, const std::vector<Json>& found,
                const std::vector<double>& panel_halves, double panel_distance_mm) {
    Table table{{"defect", "radius, lenslets", "EMD", "EMD, dark as even", "Frobenius", "transmission",
                 "lenslets of sampling noise"},
                {}};
    for (const double half : panel_halves) {
        table.header.push_back(fmt::format("light {:g} mm ({:.0f} deg)", half,
                                           std::atan2(half, panel_distance_mm) * 180 / 3.14159265358979));
    }
    for (std::size_t k = 0; k < defects.size(); ++k) {
        const Json& f = found[k];
        std::vector<std::string> row{defects[k].name, fmt::format("{:.2f}", f["radius"].get<double>())};
        for (const char* view : {"emd", "emd-even", "frobenius", "transmission"}) row.push_back(cell_text(f[view]));
        row.push_back(std::to_string(f["noisy"].get<int>()));
        for (const double half : panel_halves) row.push_back(cell_text(f[panel_key(half)]));
        table.rows.push_back(std::move(row));
    }
    return table;
}

// The lights by which the telecentric camera sees a cut but not the other defect, which EMD sees. Empty: none.
std::string lights_for(Defect::Kind kind, const std::vector<Defect>& defects, const std::vector<Json>& found,
                       const std::vector<double>& panel_halves) {
    const auto seen = [&](std::size_t k, const std::string& view) { return found[k][view]["seen"].get<bool>(); };
    std::string text;
    for (const double half : panel_halves) {
        const std::string panel = panel_key(half);
        std::string cuts, others;
        for (std::size_t k = 0; k < defects.size(); ++k) {
            if (defects[k].kind == Defect::Kind::cut && seen(k, panel))
                cuts += (cuts.empty() ? "" : " or ") + defects[k].name;
            if (defects[k].kind != kind || seen(k, panel) || !(seen(k, "emd") || seen(k, "emd-even"))) continue;
            others += (others.empty() ? "" : " or ") + defects[k].name +
                (seen(k, "emd") ? "" : " (dark lenslets taken as even)");
        }
        if (!cuts.empty() && !others.empty())
            text += fmt::format("{}light of {:g} mm: {} with {}", text.empty() ? "" : "; ", half, cuts, others);
    }
    return text;
}

}  // namespace

Result<ExperimentReport> vary_paper(const ExperimentOptions& options, const sim::Scene& lens, const Interior& emd,
                                    const Interior& frobenius, ResultCache& cells) {
    const auto defects = defects_of(lens, options.quick);
    const auto panel_halves = panels(options.quick);
    std::vector<Json> found;
    for (std::size_t k = 0; k < defects.size(); ++k) {
        options.progress(static_cast<double>(k) / static_cast<double>(defects.size()), defects[k].name);
        auto cell = cells.value(
            defects[k].key, [&] { return measure_defect(defects[k], panel_halves, emd, frobenius, options.threads); });
        if (!cell) return tl::unexpected(cell.error());
        found.push_back(std::move(*cell));
    }

    const Table table = contrasts(defects, found, panel_halves, lens.telecentric.panel_distance_mm);
    ExperimentReport report;
    if (auto done = write_csv(options.out / "vary.csv", table); !done) return tl::unexpected(done.error());
    report.files.push_back(options.out / "vary.csv");

    const std::string by_bubbles = lights_for(Defect::Kind::bubble, defects, found, panel_halves),
                      by_inclusions = lights_for(Defect::Kind::inclusion, defects, found, panel_halves);
    const std::string nowhere =
        "at none of the combinations tried: whatever bubble EMD sees, the telecentric camera sees at the same pitch";
    report.claims.push_back(
        {"The paper's picture (telecentric camera: cut seen, air bubble not; EMD: bubble seen) comes out for some "
         "light and size tried",
         !by_bubbles.empty(), by_bubbles.empty() ? nowhere : by_bubbles, false});
    report.claims.push_back({"The same with an inclusion of index 1.52 in place of the air bubble",
                             !by_inclusions.empty(), by_inclusions.empty() ? nowhere : by_inclusions});
    report.text = to_markdown(table);
    return report;
}

}  // namespace hord::lab
