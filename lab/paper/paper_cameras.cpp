#include "lab/paper/paper_cameras.h"

#include <algorithm>
#include <array>
#include <vector>

#include <fmt/format.h>

#include "hal_sim/optics/camera/render.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

constexpr int kLenslets = 41, kBins = 15;
constexpr double kDirectionsRad[] = {-0.03, 0, 0.03};
constexpr double kEqual = 0.01, kUnequal = 1;  // bins, spread over the field

// Mean offset behind each lenslet of the middle row, bins, for light of one direction and no part.
Result<std::vector<double>> offsets(double direction_rad, bool plenoptic, int threads) {
    sim::Scene scene;
    scene.part = sim::NoPart{};
    scene.camera.extents = {kLenslets, 3, kBins, kBins};
    scene.light.collimators = {{.direction_x_rad = direction_rad, .radius_rad = 0.03}};  // over several bins
    if (plenoptic) scene.camera.main_lens = {kPlenopticFocalMm, kPlenopticDistanceMm};
    const auto field = sim::render(scene, {threads, {}});
    if (!field) return tl::unexpected(field.error());
    std::vector<double> means;
    const algo::Extents& e = field->extents;
    for (int m = 0; m < e.m; ++m) {
        double sum = 0, first = 0;
        for (int j = 0; j < e.j; ++j) {
            for (int i = 0; i < e.i; ++i) {
                const auto k = static_cast<std::size_t>((e.j + j) * e.width_px() + m * e.i + i);
                sum += static_cast<double>(field->bins[k]);
                first += static_cast<double>(field->bins[k]) * (i - 0.5 * (e.i - 1));
            }
        }
        means.push_back(sum > 0 ? first / sum : 0);
    }
    return means;
}

double spread_of(const std::vector<double>& values) {
    return *std::ranges::max_element(values) - *std::ranges::min_element(values);
}

constexpr const char* kScript = R"(set datafile separator ','
set xlabel 'place of the lenslet, mm'
set ylabel 'offset behind the lenslet, bins'
set yrange [-5:5]
set key off
set grid
set multiplot layout 1,2
set title '4f camera: equal deflections, equal offsets'
plot for [k=2:4] 'paper-offsets.csv' using 1:k every ::1 with linespoints lw 2 pt 7 ps 0.5
set title 'plenoptic camera: one main lens'
plot for [k=5:7] 'paper-offsets.csv' using 1:k every ::1 with linespoints lw 2 pt 7 ps 0.5
unset multiplot
)";

}  // namespace

Result<ExperimentReport> compare_cameras(const ExperimentOptions& options, ResultCache& cells) {
    Table table{{"place, mm"}, {}};
    for (int m = 0; m < kLenslets; ++m)
        table.rows.push_back({fmt::format("{:.3f}", (m - 0.5 * (kLenslets - 1)) * sim::Camera{}.field_mm / kLenslets)});
    std::array<double, 2> spread{};  // the largest of all directions, 4f and plenoptic
    for (const bool plenoptic : {false, true}) {
        for (const double direction : kDirectionsRad) {
            const std::string name = fmt::format("{} {:g} mrad", plenoptic ? "plenoptic" : "4f", 1e3 * direction);
            const auto cell = cells.value("offsets " + name, [&]() -> Result<Json> {
                auto found = offsets(direction, plenoptic, options.threads);
                if (!found) return tl::unexpected(found.error());
                return Json(*found);
            });
            if (!cell) return tl::unexpected(cell.error());
            const auto found = cell->get<std::vector<double>>();
            table.header.push_back(name);
            for (std::size_t m = 0; m < found.size(); ++m) table.rows[m].push_back(fmt::format("{:.5f}", found[m]));
            double& most = spread[plenoptic ? 1 : 0];
            most = std::max(most, spread_of(found));
        }
    }
    ExperimentReport report;
    if (auto done = write_csv(options.out / "paper-offsets.csv", table); !done) return tl::unexpected(done.error());
    report.files.push_back(options.out / "paper-offsets.csv");
    const auto drawn = plot(options.out, "paper-offsets", kScript, 1200, 480);
    if (!drawn) return tl::unexpected(drawn.error());
    report.files.insert(report.files.end(), drawn->begin(), drawn->end());
    report.claims.push_back(
        {"Equal deflections make equal offsets behind every lenslet of the 4f camera, not of a plenoptic one",
         spread[0] < kEqual && spread[1] > kUnequal,
         fmt::format("over the field of 24 mm the offset of one direction differs by {:.2g} bins in the 4f camera, by "
                     "{:.1f} in the plenoptic one",
                     spread[0], spread[1])});
    return report;
}

}  // namespace hord::lab
