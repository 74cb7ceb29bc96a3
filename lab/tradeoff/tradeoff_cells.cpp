#include "lab/tradeoff/tradeoff_cells.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

#include "lab/experiment/scenes.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

constexpr double kRangeRad = 0.135;  // of all bins, where an axis does not change it

std::string number(double value) { return fmt::format("{:.2g}", value); }

// "0.031 (0.028 to 0.035)": the median and the range over the seeds; "-" for a size not found in any.
std::string over_seeds(std::vector<std::optional<double>> values) {
    std::ranges::sort(values,
                      [](const auto& a, const auto& b) { return a.value_or(kNeverFound) < b.value_or(kNeverFound); });
    const auto text = [](const std::optional<double>& v) { return v ? number(*v) : std::string("not found"); };
    const auto &low = values.front(), &high = values.back();
    if (!low) return "not found";
    if (values.size() == 1) return text(low);
    return fmt::format("{} ({} to {})", text(values[values.size() / 2]), text(low), text(high));
}

// The set with the smallest geometric mean of a90 in this trial; null if the cell was ruled out.
struct BestSet {
    std::string name;
    const Json* values = nullptr;
};
BestSet best_set(const Json& found) {
    BestSet best;
    double least = kNeverFound;
    for (const auto& [name, set] : found["sets"].items()) {
        double sum = 0;
        for (const Json& a90 : set["a90"]) sum += std::log(a90.is_null() ? 10.0 : a90.get<double>());
        if (best.values == nullptr || sum < least) best = {name, &set}, least = sum;
    }
    return best;
}

}  // namespace

std::vector<WantedDefect> cell_defects() {
    return {{WantedKind::bubble, 0.1}, {WantedKind::scratch, 0.012}, {WantedKind::dimple, 0.4}};
}

std::vector<CellPoint> cell_points(bool quick) {
    std::vector<CellPoint> points;
    CameraLimits camera;
    camera.fastest_lenslet = 0;  // the table tells the f-number
    if (quick) {
        camera.pixels = 0.25e6;
        for (const double pitch : {0.015, 0.06})
            points.push_back({"Bin pitch", fmt::format("{:g} mrad", 1e3 * pitch), {9, pitch, 1, 0.61, 1}, camera});
        return points;
    }
    for (const double pitch : {0.005, 0.01, 0.015, 0.03, 0.06, 0.1, 0.2}) {
        camera.pixels = 25e6;
        points.push_back({"Bin pitch, 9x9 bins, 25 megapixels",
                          fmt::format("{:g} mrad", 1e3 * pitch),
                          {9, pitch, 1, 0.61, 1},
                          camera});
    }
    for (const double pixels : {25e6, 5e6}) {
        camera.pixels = pixels;
        for (const int bins : {3, 5, 7, 9, 15})
            points.push_back({fmt::format("Lenslets against bins, {:g} megapixels", pixels / 1e6),
                              fmt::format("{0}x{0} bins", bins),
                              {bins, kRangeRad / bins, 1, 0.61, 1},
                              camera});
    }
    const CellChoice centre{9, 0.015, 1, 0.61, 1};
    camera.pixels = 25e6;
    for (const int bits : {8, 10, 12, 16}) {
        camera.bits = bits;
        points.push_back({"Bits", fmt::format("{} bits", bits), centre, camera});
    }
    camera.bits = 12;
    for (const double source : {0.15, 0.3, 0.61, 1.2, 2.4})
        points.push_back({"Source radius", fmt::format("{:g} bins", source), {9, 0.015, 1, source, 1}, camera});
    const CameraLimits one = camera;
    for (const int frames : {1, 4, 16}) {
        CameraLimits averaged = one;
        averaged.full_well_e *= frames;
        averaged.read_e *= std::sqrt(frames);
        if (frames > 1) averaged.bits = 16;
        points.push_back({"Frames averaged", std::to_string(frames), centre, averaged});
    }
    // A bin of the binned camera is four pixels.
    CameraLimits summed = one, on_chip = one;
    summed.pixels = on_chip.pixels = one.pixels / 4;
    summed.full_well_e *= 4, summed.read_e *= 2, summed.bits = 14;
    on_chip.full_well_e *= 2;
    points.push_back({"Binning", "none, 14x14 bins", {14, kRangeRad / 14, 1, 0.95, 1}, one});
    points.push_back({"Binning", "2x2 summed by the computer, 7x7 bins", {7, kRangeRad / 7, 1, 0.475, 1}, summed});
    points.push_back(
        {"Binning", "2x2 on the chip (twice the full well), 7x7 bins", {7, kRangeRad / 7, 1, 0.475, 1}, on_chip});
    return points;
}

Result<Json> try_cell_point(const CellPoint& point, std::uint64_t seed, bool quick, int threads) {
    DesignTask task;
    task.part = lens_scene(111);
    task.defects = cell_defects();
    task.camera = point.camera;
    task.seed = seed;
    task.threads = threads;
    const auto survey = PartSurvey::of(task.part);
    if (!survey) return tl::unexpected(survey.error());
    const auto trial = try_cell(point.cell, task, *survey, quick ? Effort{2, 1, 1} : Effort{4, 3, 2});
    if (!trial) return tl::unexpected(trial.error());
    Json found{{"problem", trial->problem}, {"sets", Json::object()}};
    for (const SetTrial& set : trial->sets) {
        Json a90 = Json::array();
        for (const FoundSize& size : set.found) a90.push_back(size.a90_mm == kNeverFound ? Json() : Json(size.a90_mm));
        found["sets"][set.set.name()] = {{"ms", set.time_ms}, {"a90", std::move(a90)}};
    }
    return found;
}

std::string describe_cells(const std::vector<TriedCell>& cells) {
    std::string text;
    const sim::Scene lens = lens_scene(111);
    const auto defects = cell_defects();
    std::string axis;
    Table table;
    const auto flush = [&] {
        if (!table.rows.empty()) text += (text.empty() ? "### " : "\n### ") + axis + "\n\n" + to_markdown(table);
        table = {{"cell", "lenslets", "f-number"}, {}};
        for (const WantedDefect& defect : defects) table.header.push_back(std::string(defect.name()) + ", mm");
        table.header.emplace_back("best features");
        table.header.emplace_back("time, ms");
    };
    for (const TriedCell& cell : cells) {
        if (cell.point.axis != axis) flush(), axis = cell.point.axis;
        std::vector<std::string> row{
            cell.point.label, std::to_string(lenslets_of(cell.point.cell, cell.point.camera)),
            fmt::format("f/{:.2g}", optics_of(cell.point.cell, lens, cell.point.camera).f_number())};
        std::vector<std::vector<std::optional<double>>> sizes(defects.size());
        std::vector<std::optional<double>> times;
        std::vector<std::string> names;
        for (const Json& found : cell.found) {
            const BestSet best = best_set(found);
            if (best.values == nullptr) continue;
            for (std::size_t d = 0; d < defects.size(); ++d) {
                const Json& a90 = (*best.values)["a90"][d];
                sizes[d].push_back(a90.is_null() ? std::nullopt : std::optional(a90.get<double>()));
            }
            times.emplace_back((*best.values)["ms"].get<double>());
            if (std::ranges::find(names, best.name) == names.end()) names.push_back(best.name);
        }
        if (names.empty()) {
            row.insert(row.end(), defects.size(), "-");
            row.push_back("not tried: " + cell.found.front()["problem"].get<std::string>());
            row.emplace_back("-");
        } else {
            for (auto& of : sizes) row.push_back(over_seeds(of));
            std::string best;
            for (const std::string& name : names) best += (best.empty() ? "" : " / ") + name;
            row.push_back(best);
            row.push_back(over_seeds(times));
        }
        table.rows.push_back(std::move(row));
    }
    flush();
    return text;
}

}  // namespace hord::lab
