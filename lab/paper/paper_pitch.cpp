#include "lab/paper/paper_pitch.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/scenes.h"
#include "lab/optics/truth.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

constexpr double kLightFloor = 0.01;  // of the light: as paper_views.h
constexpr int kCleanWindow = 31;
constexpr double kCleanPlacesMm[] = {0, 1.5, 3, 4.5, 6};  // along the diagonal; the lens ends at 7.07

std::vector<double> pitches(bool quick) {
    return quick ? std::vector<double>{0.015, 0.06} : std::vector<double>{0.005, 0.01, 0.015, 0.03, 0.06, 0.1, 0.2};
}

struct SeenDefect {
    double emd = 0, frobenius = 0, transmission = 0, with_hord = 0;  // contrasts; share of the defect's lenslets
};

struct Look {
    InspectedMaps maps;
    std::vector<float> missing;  // light
};
Result<Look> look_at(const sim::Scene& scene, int threads) {
    const auto light = sim::render(scene, {threads, {}});
    if (!light) return tl::unexpected(light.error());
    auto maps = inspect_frame(sim::expose(*light, scene, scene.seed), scene.camera.extents, 1);
    if (!maps) return tl::unexpected(maps.error());
    Look look{std::move(*maps), {}};
    // In units of the median: the part fills the window.
    for (const float t : look.maps.transmission) look.missing.push_back(std::abs(1 - t));
    return look;
}

// The values of the clean windows, pooled.
struct CleanLens {
    Interior emd, frobenius;
    double without_hord = 0;  // share of its lenslets
};
Result<CleanLens> clean_lens(const sim::Scene& lens, int threads) {
    std::vector<float> emd, frobenius;
    std::vector<std::uint8_t> mask;
    for (const double at : kCleanPlacesMm) {
        const auto look = look_at(close_up(lens, at, at, kCleanWindow), threads);
        if (!look) return tl::unexpected(look.error());
        for (std::size_t k = 0; k < look->maps.mask.size(); ++k) {
            if ((look->maps.mask[k] & algo::kBorder) != 0) continue;
            emd.push_back(look->maps.emd[k]), frobenius.push_back(look->maps.frobenius[k]);
            mask.push_back(static_cast<std::uint8_t>(look->maps.mask[k] & algo::kNoHord));
        }
    }
    const auto dark = std::ranges::count_if(mask, [](std::uint8_t bits) { return bits != algo::kValid; });
    return CleanLens{interior_of(emd, mask), interior_of(frobenius, mask),
                     static_cast<double>(dark) / static_cast<double>(mask.size())};
}

Result<SeenDefect> see(const sim::Scene& lens, const CleanLens& clean, const sim::SceneDefect& defect, double x_mm,
                       double y_mm, double reach_mm, int threads) {
    const double pitch = lens.camera.field_mm / lens.camera.extents.m;
    sim::Scene scene = close_up(lens, x_mm, y_mm, 2 * static_cast<int>(std::ceil(reach_mm / pitch)) + 31);
    scene.defects = {defect};
    const auto look = look_at(scene, threads);
    if (!look) return tl::unexpected(look.error());
    const algo::Extents& e = scene.camera.extents;
    const auto truth = truth_of(scene);
    if (truth.defects.empty()) return fail(ErrorCode::internal, "the defect is not in sight", "report this");
    const TruthDefect& where = truth.defects[0];
    const std::vector<std::uint8_t> all_valid(e.lenslets(), algo::kValid);
    SeenDefect seen{contrast_of(look->maps.emd, look->maps.mask, e, where, clean.emd, 0).ratio,
                    contrast_of(look->maps.frobenius, look->maps.mask, e, where, clean.frobenius, 0).ratio,
                    contrast_of(look->missing, all_valid, e, where, {}, kLightFloor).ratio, 0};
    int inside = 0, lit = 0;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            if (std::hypot(m - where.m, n - where.n) > where.radius_lenslets) continue;
            ++inside;
            lit += (look->maps.mask[static_cast<std::size_t>(n * e.m + m)] & algo::kNoHord) == 0 ? 1 : 0;
        }
    }
    seen.with_hord = inside > 0 ? static_cast<double>(lit) / inside : 0;
    return seen;
}

Json to_json(const SeenDefect& s) { return {s.emd, s.frobenius, s.transmission, s.with_hord}; }

}  // namespace

Result<ExperimentReport> vary_pitch(const ExperimentOptions& options, const sim::Scene& lens, ResultCache& cells) {
    Table table{{"bin pitch, mrad", "clean lens without HORD"}, {}};
    for (const char* defect : {"cut", "bubble", "absorber"}) {
        for (const char* value : {"EMD", "Frobenius", "missing light", "lenslets with HORD"})
            table.header.push_back(fmt::format("{}: {}", defect, value));
    }
    const auto all = pitches(options.quick);
    std::vector<Json> found;
    for (std::size_t k = 0; k < all.size(); ++k) {
        options.progress(static_cast<double>(k) / static_cast<double>(all.size()),
                         fmt::format("bins of {:g} mrad", 1e3 * all[k]));
        sim::Scene scene = lens;
        scene.camera.bin_pitch_rad = all[k];
        const auto cell = cells.value(fmt::format("pitch {:g}", all[k]), [&]() -> Result<Json> {
            const auto clean = clean_lens(scene, options.threads);
            if (!clean) return tl::unexpected(clean.error());
            const auto cut = cut_of_lens(1.0);
            Json row{clean->without_hord};
            const auto add = [&](const sim::SceneDefect& defect, double x, double y, double reach) -> Result<void> {
                const auto seen = see(scene, *clean, defect, x, y, reach, options.threads);
                if (!seen) return tl::unexpected(seen.error());
                row.push_back(to_json(*seen));
                return {};
            };
            const auto absorber = absorber_of_lens(0.5);
            if (auto done = add(cut, cut.centre_mm.x, cut.centre_mm.y, 1.42); !done)
                return tl::unexpected(done.error());
            if (auto done = add(bubble_of_lens(0.5), 0, 0, 0.5); !done) return tl::unexpected(done.error());
            if (auto done = add(absorber, absorber.centre_mm.x, absorber.centre_mm.y, 0.4); !done)
                return tl::unexpected(done.error());
            return row;
        });
        if (!cell) return tl::unexpected(cell.error());
        found.push_back(*cell);
        std::vector<std::string> row{fmt::format("{:g}", 1e3 * all[k]),
                                     fmt::format("{:.0f} %", 100 * (*cell)[0].get<double>())};
        for (std::size_t d = 1; d <= 3; ++d) {
            for (std::size_t v = 0; v < 3; ++v) {
                const double ratio = (*cell)[d][v].get<double>();
                const std::string text = ratio < 9.95 ? fmt::format("{:.1f}", ratio) : fmt::format("{:.0f}", ratio);
                row.push_back(ratio >= kVisible ? "**" + text + "**" : text);
            }
            row.push_back(fmt::format("{:.0f} %", 100 * (*cell)[d][3].get<double>()));
        }
        table.rows.push_back(std::move(row));
    }
    ExperimentReport report;
    if (auto done = write_csv(options.out / "pitch.csv", table); !done) return tl::unexpected(done.error());
    report.files.push_back(options.out / "pitch.csv");
    report.text = to_markdown(table);

    const auto at = [&](double pitch) -> const Json& {
        return found[static_cast<std::size_t>(std::ranges::find(all, pitch) - all.begin())][2];
    };
    const auto number = [](const Json& bubble, std::size_t k) { return bubble[k].get<double>(); };
    const Json &narrow = at(0.015), &wide = at(0.06);
    const std::string evidence = fmt::format(
        "15 mrad: EMD {:.1f}, missing light {:.0f}, {:.0f} % of its lenslets with a HORD; 60 mrad: EMD {:.0f}, "
        "missing light {:.0f}, {:.0f} %",
        number(narrow, 0), number(narrow, 2), 100 * number(narrow, 3), number(wide, 0), number(wide, 2),
        100 * number(wide, 3));
    report.claims.push_back({"With bins of 15 mrad the missing light shows the bubble better than the EMD gradient",
                             number(narrow, 2) > number(narrow, 0), evidence});
    report.claims.push_back({"With bins of 60 mrad, too", number(wide, 2) > number(wide, 0), evidence, false});
    return report;
}

}  // namespace hord::lab
