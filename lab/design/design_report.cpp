// The answer of a design as text.
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "lab/design/design.h"
#include "lab/report/tables.h"

namespace hord::lab {
namespace {

constexpr std::size_t kNextBest = 6;
constexpr std::size_t kOtherSets = 2;  // of them, sets of the chosen cell: often all are equal

std::string a90_text(const FoundSize& found) {
    if (found.a90_mm == kNeverFound) return "not found";
    if (found.at_most) return fmt::format("<= {:.2g}", found.a90_mm);
    const std::string bound =
        found.a90_95_mm == kNeverFound ? std::string("no bound") : fmt::format("{:.2g}", found.a90_95_mm);
    return fmt::format("{:.2g} ({})", found.a90_mm, bound);
}

// The share of a binomial, by bisection, at which `hits` or fewer of `trials` have this probability.
double share_with_tail(int hits, int trials, double probability) {
    if (trials == 0) return 1;
    double low = 0, high = 1;
    for (int step = 0; step < 60; ++step) {
        const double p = 0.5 * (low + high);
        double term = std::pow(1 - p, trials), tail = term;
        for (int k = 1; k <= hits; ++k) term *= (trials - k + 1.0) / k * p / (1 - p), tail += term;
        (tail > probability ? low : high) = p;
    }
    return hits == trials ? 1 : low;
}
// One-sided 95 % bounds of a share, Clopper-Pearson.
double binomial_upper(int hits, int trials) { return share_with_tail(hits, trials, 0.05); }
double binomial_lower(int hits, int trials) { return hits == 0 ? 0 : share_with_tail(hits - 1, trials, 0.95); }

// What the counted rejects say of the share that is aimed at. "" where they show it.
std::string aim_text(const WholeCheck& check, double aim) {
    if (check.good == 0 || binomial_upper(check.rejected, check.good) <= aim) return "";
    const std::string verdict = misses_aim(check, aim)
        ? fmt::format("**The aim is missed**: with 95 % confidence {:.2g} % or more are rejected.",
                      100 * binomial_lower(check.rejected, check.good))
        : fmt::format("**The aim is not shown**: with 95 % confidence it takes {:.0f} good parts without a reject.",
                      std::ceil(std::log(0.05) / std::log1p(-aim)));
    return verdict + " Tune the limits with good parts of the line (hordctl tune) before production.\n";
}
std::string share_text(int hits, int trials, bool misses) {
    const int bad = misses ? trials - hits : hits;
    return fmt::format("{} of {} (at most {:.0f} % {})", hits, trials, 100 * binomial_upper(bad, trials),
                       misses ? "missed" : "rejected");
}

std::string limits_text(const algo::Recipe& recipe) {
    std::string text;
    const auto add = [&](const std::string& one) { text += (text.empty() ? "" : ", ") + one; };
    if (recipe.gradient)
        add(fmt::format("{} {:.3g} {}", name_of(*recipe.gradient), limit_of_gradient(recipe),
                        unit_of(*recipe.gradient)));
    if (recipe.slopes) add(fmt::format("jacobian-frobenius {:.3g} bin pitches a lenslet", recipe.frobenius_limit_bins));
    if (recipe.light) add(fmt::format("transmission {:.3g}", recipe.transmission_limit));
    return text;
}

// What to order: lenslet array, relay, collimator.
std::string hardware_text(const CellChoice& cell, const DesignTask& task) {
    const CellOptics optics = optics_of(cell, task.part, task.camera);
    return fmt::format(
        "With pixels of {:.3g} um: lenslets of {:.4g} um pitch and {:.4g} um focal length (f/{:.2g}), a relay "
        "with f2/f1 = {:.3g} (field {:g} mm), a collimated source of {:.3g} mrad angular radius.",
        task.camera.pixel_um, optics.lenslet_um, optics.focal_um, optics.f_number(), optics.magnification,
        task.part.camera.field_mm, 1e3 * cell.source_radius_bins * cell.bin_pitch_rad);
}

// Where the time of a verdict is near what the rate leaves, a busier or faster machine may choose otherwise.
std::string rate_text(const Design& design, const DesignTask& task) {
    constexpr double kNear = 2;  // the times of one program differ by less on a busy machine and an idle one
    const double most = kUseOfCore * task.inspection_threads / (task.rate * 1e-3);
    const auto near = [&](const CellTrial& trial) {
        return std::ranges::any_of(
            trial.sets, [&](const SetTrial& set) { return set.time_ms > most / kNear && set.time_ms < most * kNear; });
    };
    if (std::ranges::none_of(design.coarse, near) && std::ranges::none_of(design.fine, near)) return "";
    return fmt::format(
        " **The rate decided**: some cells take nearly the {:.3g} ms that it leaves, so another machine or "
        "load may choose another cell.",
        most);
}

struct Choice {
    const CellTrial* cell = nullptr;
    const SetTrial* set = nullptr;
};
// The best set of each cell, and the chosen cell's next sets; the best first.
std::vector<Choice> next_best(const Design& design) {
    std::vector<Choice> all;
    const CellTrial& chosen = design.fine.front();
    for (std::size_t s = 1; s < std::min(chosen.sets.size(), kOtherSets + 1); ++s)
        all.push_back({&chosen, &chosen.sets[s]});
    const auto add = [&](const std::vector<CellTrial>& trials) {
        for (const CellTrial& trial : trials) {
            if (trial.sets.empty() ||
                std::ranges::any_of(all, [&](const Choice& c) { return c.cell->cell == trial.cell; }))
                continue;
            all.push_back({&trial, &trial.sets.front()});
        }
    };
    add(design.fine);
    add(design.coarse);
    std::ranges::stable_sort(all, [](const Choice& a, const Choice& b) { return is_better(*a.set, *b.set); });
    if (all.size() > kNextBest) all.resize(kNextBest);
    return all;
}

Table choices_table(const Design& design, const DesignTask& task) {
    Table table{{"cell", "features"}, {}};
    for (const WantedDefect& wanted : task.defects) table.header.push_back(fmt::format("{} a90, mm", wanted.name()));
    for (const char* name : {"time a part, ms", "a90 against the chosen", "time against the chosen"})
        table.header.emplace_back(name);
    const SetTrial& best = design.fine.front().sets.front();
    const auto add = [&](const CellTrial& cell, const SetTrial& set) {
        std::vector<std::string> row{describe(cell.cell, task.part, task.camera), set.set.name()};
        for (const FoundSize& found : set.found) row.push_back(a90_text(found));
        row.push_back(fmt::format("{:.1f}{}", set.time_ms, set.holds_rate ? "" : " (too slow)"));
        row.push_back(set.worst_ratio == kNeverFound ? "-"
                                                     : fmt::format("x {:.2g}", set.worst_ratio / best.worst_ratio));
        row.push_back(fmt::format("x {:.2g}", set.time_ms / best.time_ms));
        table.rows.push_back(std::move(row));
    };
    add(design.fine.front(), best);
    for (const Choice& choice : next_best(design)) add(*choice.cell, *choice.set);
    return table;
}

Table ruled_out(const Design& design) {
    Table table{{"ruled out because", "cells"}, {}};
    for (const CellTrial& trial : design.coarse) {
        if (trial.problem.empty()) continue;
        const std::string cell = fmt::format(
            "{0}x{0} at {1:.3g} mrad{2}{3}", trial.cell.bins, 1e3 * trial.cell.bin_pitch_rad,
            trial.cell.pixels_share == 1 ? "" : fmt::format(" on {:g} of the width", trial.cell.pixels_share),
            trial.cell.source_radius_bins == CellChoice{}.source_radius_bins
                ? ""
                : fmt::format(" with a source of {:g} bin", trial.cell.source_radius_bins));
        const auto row = std::ranges::find_if(table.rows, [&](const auto& r) { return r[0] == trial.problem; });
        if (row == table.rows.end()) table.rows.push_back({trial.problem, cell});
        else (*row)[1] += ", " + cell;
    }
    return table;
}

// What the part's scene says of its own camera's optics, which a design does not take.
std::string dropped_text(const sim::Camera& camera) {
    std::string names;
    const auto add = [&](bool is_set, const char* name) {
        if (is_set) names += (names.empty() ? "" : ", ") + std::string(name);
    };
    const sim::Relay &relay = camera.relay, usual;
    add(camera.main_lens.focal_mm > 0, "main_lens");
    add(relay.f1_mm != usual.f1_mm || relay.f2_mm != usual.f2_mm || relay.stop_radius_mm > 0 ||
            relay.lens1_radius_mm > 0 || relay.lens2_radius_mm > 0,
        "relay");
    add(!camera.dust.empty(), "dust");
    return names.empty() ? names : "Not taken from the scene's camera, whose place the cell takes: " + names + ".\n\n";
}

}  // namespace

bool holds_rate(const WholeCheck& check, const DesignTask& task) {
    return check.time_ms * 1e-3 * task.rate <= kUseOfCore * task.inspection_threads;
}

bool meets(const Design& design, const DesignTask& task) {
    return holds_rate(design.check, task) && design.check.worst_ratio <= 1 &&
        !misses_aim(design.check, task.false_rejects);
}

bool misses_aim(const WholeCheck& check, double aim) { return binomial_lower(check.rejected, check.good) > aim; }

std::string describe(const Design& design, const DesignTask& task) {
    const CellTrial& chosen = design.fine.front();
    const SetTrial& set = chosen.sets.front();
    const WholeCheck& check = design.check;
    std::string text = fmt::format(
        "Part {}, {:.3g} megapixels of {} bits, full well {:g} e-, {:g} parts a second, seed {}.\n\n", task.part.name,
        task.camera.pixels * 1e-6, task.camera.bits, task.camera.full_well_e, task.rate, task.seed);
    text += dropped_text(task.part.camera);
    text += fmt::format("**Build: {}.** Judge by {}.\n{}\n\n", describe(chosen.cell, task.part, task.camera),
                        set.set.name(), hardware_text(chosen.cell, task));
    std::string missed;  // wanted sizes below the size found
    for (std::size_t d = 0; d < task.defects.size(); ++d) {
        if (worst_ratio({check.found[d]}, {task.defects[d]}) <= 1) continue;
        missed += fmt::format(
            "{}{} of {:g} mm{}", missed.empty() ? "" : ", ", task.defects[d].name(), task.defects[d].size_mm,
            check.found[d].a90_mm == kNeverFound ? "" : fmt::format(" (a90 {:.3g} mm)", check.found[d].a90_mm));
    }
    text += fmt::format("It {}, and {} {:g} parts a second with {} inspection thread{}.\n\n",
                        check.worst_ratio <= 1 ? "finds every wanted size with 90 % probability or more"
                                               : "does not find with 90 % probability: " + missed,
                        holds_rate(check, task) ? "holds" : "DOES NOT HOLD", task.rate, task.inspection_threads,
                        task.inspection_threads == 1 ? "" : "s");
    Table defects{{"defect", "wanted, mm", "a90, mm (with 95 % confidence)", "whole parts of another seed: wanted size",
                   "of size a90"},
                  {}};
    for (std::size_t d = 0; d < task.defects.size(); ++d) {
        const DefectCheck& of = check.defects[d];
        defects.rows.push_back({std::string(task.defects[d].name()), fmt::format("{:g}", task.defects[d].size_mm),
                                a90_text(check.found[d]), share_text(of.wanted.found, of.wanted.tried, true),
                                of.a90.tried > 0 ? share_text(of.a90.found, of.a90.tried, true) : "-"});
    }
    text += to_markdown(defects) + "\n";
    text += fmt::format(
        "Good parts rejected: {:g} aimed at, {} counted{}. Limits: {}, from {} frames. They know noise and where the "
        "part "
        "lies.\n",
        task.false_rejects, share_text(check.rejected, check.good, false),
        check.rejected > 0 ? fmt::format(" ({})", name_of(check.reason)) : "", limits_text(check.recipe),
        check.limit_frames);
    text += aim_text(check, task.false_rejects);
    if (check.recipe.rim_margin != task.base.rim_margin) {
        text += fmt::format(
            "The outermost {} lenslets of the part are not judged: the light beside its edge is dark, or differs much "
            "from part to part.\n",
            check.recipe.rim_margin);
    }
    text += fmt::format(
        "A verdict takes {:.1f} ms of one core of this machine (median of {} parts; longest {:.1f} ms).{}\n\n",
        check.time_ms, check.good, check.longest_ms, rate_text(design, task));
    text +=
        (task.camera.diffraction ? std::string()
                                 : std::string("Haze is wanted: the cells are simulated without diffraction.\n\n")) +
        "The chosen cell and the next-best choices, with the limits of windows of the part (the best cells with more "
        "trials than the others):\n\n" +
        to_markdown(choices_table(design, task)) + "\n";
    const Table out = ruled_out(design);
    if (!out.rows.empty()) text += to_markdown(out) + "\n";
    text += fmt::format("{} cells in {:.0f} s ({:.0f} s of processor time).\n", design.coarse.size(), design.seconds,
                        design.cpu_seconds);
    return text;
}

}  // namespace hord::lab
