#include "lab/design/design.h"

#include <algorithm>
#include <chrono>

#include <fmt/format.h>

#include "lab/report/cpu_time.h"

namespace hord::lab {
namespace {

constexpr int kBins[] = {3, 5, 7, 9, 15};
constexpr int kBinsQuick[] = {5, 9};
constexpr double kPitches[] = {0.005, 0.015, 0.03, 0.06, 0.1, 0.2};
constexpr double kPitchesQuick[] = {0.015, 0.06};
constexpr double kSources[] = {0.3, 1.2};
constexpr double kPitchSteps[] = {0.7, 1.4};
constexpr std::size_t kStarts = 3, kFine = 3;
constexpr int kFitCells = 2;

bool cell_is_better(const CellTrial& a, const CellTrial& b) {
    if (a.sets.empty() || b.sets.empty()) return !a.sets.empty();
    return is_better(a.sets.front(), b.sets.front());
}

class Search {
  public:
    Search(const DesignTask& task, const PartSurvey& survey, const DesignOptions& options)
        : task_(task), survey_(survey), options_(options) {}

    Result<Design> run() {
        if (auto fit = find_fit(); !fit) return tl::unexpected(fit.error());
        const std::vector<CellChoice> grid = grid_of_cells();
        if (auto done = try_all(grid, 0, 0.45); !done) return tl::unexpected(done.error());
        std::vector<CellChoice> steps;
        for (const CellChoice& start : best(options_.quick ? 1 : kStarts)) {
            for (const CellChoice& next : steps_from(start)) {
                if (!was_tried(next) && std::ranges::find(steps, next) == steps.end()) steps.push_back(next);
            }
        }
        if (auto done = try_all(steps, 0.45, 0.75); !done) return tl::unexpected(done.error());
        const auto finalists = best(options_.quick ? 2 : kFine);
        if (finalists.empty()) {
            return fail(ErrorCode::unsupported, "no cell shows part " + task_.part.name + ": " + first_problem(),
                        "give a camera with more pixels (--pixels), or a scene with a smaller field_mm");
        }
        DesignTask again = task_;
        again.seed += 100;
        const Effort effort = options_.quick ? Effort{4, 2, 2} : Effort{6, 5, 3};
        for (std::size_t k = 0; k < finalists.size(); ++k) {
            options_.progress(0.75 + 0.1 * static_cast<double>(k) / static_cast<double>(finalists.size()), "finer");
            auto trial = try_cell(finalists[k], again, survey_, effort);
            if (!trial) return tl::unexpected(trial.error());
            design_.fine.push_back(std::move(*trial));
        }
        std::ranges::stable_sort(design_.fine, cell_is_better);
        const CellTrial& chosen = design_.fine.front();
        auto check =
            check_whole_parts(chosen.cell, chosen.sets.front(), task_, survey_,
                              options_.quick ? CheckEffort{8, 1, 8, 4, effort} : CheckEffort{10, 2, 4, 8, effort},
                              [&](double done) { options_.progress(0.85 + 0.15 * done, "whole parts"); });
        if (!check) return tl::unexpected(check.error());
        design_.check = std::move(*check);
        return std::move(design_);
    }

    // Fails where a good part is unfit in the first cells that are not ruled out: no search would find a cell then.
    [[nodiscard]] Result<void> find_fit() const {
        Result<void> fit;
        int tried = 0;
        for (const CellChoice& cell : grid_of_cells()) {
            if (!problem_of(cell, task_.part, task_.camera, survey_.largest_slope).empty()) continue;
            if (tried++ == kFitCells) return fit;
            options_.progress(0, "a good part in " + describe(cell, task_.part, task_.camera));
            fit = check_good_part(cell, task_);
            if (fit) return fit;
        }
        return fit;
    }

  private:
    [[nodiscard]] std::vector<CellChoice> grid_of_cells() const {
        std::vector<CellChoice> cells;
        const auto bins = options_.quick ? std::span<const int>(kBinsQuick) : kBins;
        const auto pitches = options_.quick ? std::span<const double>(kPitchesQuick) : kPitches;
        for (const int n : bins) {
            for (const double pitch : pitches) cells.push_back({n, pitch, 1, 0.61, 1});
        }
        return cells;
    }
    [[nodiscard]] static std::vector<CellChoice> steps_from(const CellChoice& start) {
        std::vector<CellChoice> cells;
        const auto with = [&](auto change) {
            CellChoice next = start;
            change(next);
            cells.push_back(next);
        };
        for (const double source : kSources) with([&](CellChoice& c) { c.source_radius_bins = source; });
        for (const double step : kPitchSteps) with([&](CellChoice& c) { c.bin_pitch_rad *= step; });
        with([](CellChoice& c) { c.pixels_share = 0.5; });
        with([](CellChoice& c) { c.light = 0.25; });
        return cells;
    }
    [[nodiscard]] bool was_tried(const CellChoice& cell) const {
        return std::ranges::find(design_.coarse, cell, &CellTrial::cell) != design_.coarse.end();
    }
    [[nodiscard]] std::string first_problem() const {
        for (const CellTrial& trial : design_.coarse) {
            if (!trial.problem.empty()) return trial.problem;
        }
        return "no defect is found";
    }
    [[nodiscard]] std::vector<CellChoice> best(std::size_t count) const {
        std::vector<const CellTrial*> order;
        for (const CellTrial& trial : design_.coarse) {
            if (!trial.sets.empty()) order.push_back(&trial);
        }
        std::ranges::stable_sort(order, [](const auto* a, const auto* b) { return cell_is_better(*a, *b); });
        std::vector<CellChoice> cells;
        for (std::size_t k = 0; k < std::min(count, order.size()); ++k) cells.push_back(order[k]->cell);
        return cells;
    }

    Result<void> try_all(const std::vector<CellChoice>& cells, double from, double to) {
        for (std::size_t k = 0; k < cells.size(); ++k) {
            options_.progress(from + (to - from) * static_cast<double>(k) / static_cast<double>(cells.size()),
                              describe(cells[k], task_.part, task_.camera));
            auto trial = try_cell(cells[k], task_, survey_, {});
            if (!trial) return tl::unexpected(trial.error());
            design_.coarse.push_back(std::move(*trial));
        }
        return {};
    }

    const DesignTask& task_;
    const PartSurvey& survey_;
    const DesignOptions& options_;
    Design design_;
};

}  // namespace

Result<void> check_task(const DesignTask& task, const PartSurvey& survey) {
    if (task.rate > kHighestRate) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{:g} parts a second are more than a station times: its light rests 5 ms after a pulse "
                                "(strobe.min_rest_ms), and a frame's time stamp is right to 2 ms",
                                task.rate),
                    fmt::format("give --rate {:g} or less, and share the line's parts between cells", kHighestRate));
    }
    for (const WantedDefect& wanted : task.defects) {
        if ((wanted.kind == WantedKind::bubble || wanted.kind == WantedKind::inclusion) &&
            wanted.size_mm >= survey.thickest_mm) {
            return fail(ErrorCode::invalid_argument,
                        fmt::format("{}={:g} does not fit into part {}, whose glass is {:.3g} mm thick", wanted.name(),
                                    wanted.size_mm, task.part.name, survey.thickest_mm),
                        "give a smaller size, or a defect of a face (cut, dimple, scratch)");
        }
    }
    if (survey.fills_field == (task.base.form == algo::PartForm::web)) return {};
    return survey.fills_field
        ? fail(ErrorCode::invalid_argument, "part " + task.part.name + " fills the field: it is a web",
               "give --form web, or a scene with a larger camera.field_mm")
        : fail(ErrorCode::invalid_argument, "part " + task.part.name + " does not fill the field: it is no web",
               "give --form round or plate, or a scene with a smaller camera.field_mm");
}

algo::PartForm form_of(DesignTask task, const PartSurvey& survey, const DesignOptions& options) {
    if (survey.fills_field) return algo::PartForm::web;
    if (std::holds_alternative<sim::Plate>(task.part.part)) return algo::PartForm::plate;
    const auto is_judged_as = [&](algo::PartForm form) {
        task.base.form = form;
        return Search(task, survey, options).find_fit().has_value();
    };
    return !is_judged_as(algo::PartForm::round) && is_judged_as(algo::PartForm::plate) ? algo::PartForm::plate
                                                                                       : algo::PartForm::round;
}

Result<Design> design_cell(const DesignTask& task, const DesignOptions& options) {
    const auto survey = PartSurvey::of(task.part);
    if (!survey) return tl::unexpected(survey.error());
    if (auto checked = check_task(task, *survey); !checked) return tl::unexpected(checked.error());
    const auto start = std::chrono::steady_clock::now();
    const double cpu = process_cpu_ms();
    auto design = Search(task, *survey, options).run();
    if (!design) return design;
    design->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    design->cpu_seconds = (process_cpu_ms() - cpu) * 1e-3;
    options.progress(1, "");
    return design;
}

}  // namespace hord::lab
