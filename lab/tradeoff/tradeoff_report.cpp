// The trade-off's report: tables, claims and the fields of docs/results/templates/tradeoff.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>

#include <fmt/format.h>

#include "lab/report/tables.h"
#include "lab/report/template.h"
#include "lab/tradeoff/tradeoff.h"
#include "lab/tradeoff/tradeoff_plots.h"
#include "lab/tradeoff/tradeoff_rating.h"

namespace hord::lab {
namespace {

std::string size_text(const std::optional<double>& a90, const std::optional<double>& a90_95, double largest) {
    if (!a90 || *a90 > largest) return fmt::format("> {:g}", largest);
    return fmt::format("{:.2f} ({})", *a90,
                       a90_95 && *a90_95 <= largest ? fmt::format("{:.2f}", *a90_95) : fmt::format("> {:g}", largest));
}
std::string found_text(const Rated& r) {
    std::string text;
    for (const Estimate& t : r.tpr) text += fmt::format("{}{:.0f}", text.empty() ? "" : " / ", 100 * t.value);
    return text;
}

Table everything(const TradeoffResults& results) {
    Table table{{"bins",        "slope",     "photons",  "frames", "stride",  "range_mrad",
                 "source_mrad", "feature",   "family",   "auc",    "auc_low", "auc_high",
                 "tpr",         "tpr_low",   "tpr_high", "a90",    "a90_95",  "error_over_threshold",
                 "flips",       "median_ms", "p99_ms"},
                {}};
    const auto number = [](double v) { return fmt::format("{:.6g}", v); };
    for (const auto& cell : results.scores) {
        const TradeoffPoint& p = cell.point;
        const bool timed = results.times_at(p) != nullptr;
        for (const Rated& r : rated_at(results, p)) {
            for (std::size_t f = 0; f < kFamilies; ++f) {
                table.rows.push_back({std::to_string(p.bins),
                                      number(p.slope),
                                      std::to_string(p.photons),
                                      std::to_string(p.frames),
                                      std::to_string(p.stride),
                                      number(p.range_mrad),
                                      number(p.source_mrad),
                                      r.name,
                                      std::string(kFamilyNames[f]),
                                      number(r.auc[f].value),
                                      number(r.auc[f].low),
                                      number(r.auc[f].high),
                                      number(r.tpr[f].value),
                                      number(r.tpr[f].low),
                                      number(r.tpr[f].high),
                                      r.a90[f] ? number(*r.a90[f]) : "",
                                      r.a90_95[f] ? number(*r.a90_95[f]) : "",
                                      number(r.error_of_threshold),
                                      number(r.flips),
                                      timed ? number(r.median_ms) : "",
                                      timed ? number(r.p99_ms) : ""});
            }
        }
    }
    return table;
}

Table centre_table(const std::vector<Rated>& all) {
    Table table{{"feature", "ms: median, p99"}, {}};
    for (const std::string_view name : kFamilyNames) {
        table.header.push_back(fmt::format("{}: AUC", name));
        table.header.push_back("found");
        table.header.push_back("90 % from");
    }
    for (const char* more : {"error / threshold", "flips", "dominated by"}) table.header.emplace_back(more);
    std::vector<Rated> sorted = all;
    std::ranges::sort(sorted, [](const Rated& a, const Rated& b) { return a.mean_tpr() > b.mean_tpr(); });
    for (const Rated& r : sorted) {
        std::vector<std::string> row{r.name, fmt::format("{:.3g}, {:.3g}", r.median_ms, r.p99_ms)};
        for (std::size_t f = 0; f < kFamilies; ++f) {
            row.push_back(fmt::format("{:.2f} [{:.2f}, {:.2f}]", r.auc[f].value, r.auc[f].low, r.auc[f].high));
            row.push_back(fmt::format("{:.0f} [{:.0f}, {:.0f}] %", 100 * r.tpr[f].value, 100 * r.tpr[f].low,
                                      100 * r.tpr[f].high));
            row.push_back(size_text(r.a90[f], r.a90_95[f], kLargest[f]));
        }
        const Rated *within = dominator(all, r, true), *overall = dominator(all, r, false);
        std::string by = within != nullptr ? within->name : overall == nullptr ? "-" : "";
        if (overall != nullptr && overall != within)
            by += (by.empty() ? "" : "; ") + fmt::format("({})", overall->name);
        row.insert(row.end(),
                   {fmt::format("{:.2f}", r.error_of_threshold), fmt::format("{:.0f} %", 100 * r.flips), by});
        table.rows.push_back(std::move(row));
    }
    return table;
}

bool has_usual_optics(const TradeoffPoint& p) {
    return p.range_mrad == kCentre.range_mrad && p.source_mrad == kCentre.source_mrad;
}
bool is_choice(const TradeoffPoint& p) { return p.bins == 9 && p.frames == 1 && p.stride == 1 && has_usual_optics(p); }

// For each slope and light: the feature that finds most, and the fastest one that finds as much.
Table choice_table(const TradeoffResults& results) {
    Table table{{"slope", "photons", "the light alone"}, {}};
    for (const Kind kind : {Kind::neighbours, Kind::reference}) {
        table.header.push_back(fmt::format("most {}", kKindNames[static_cast<std::size_t>(kind)]));
        table.header.emplace_back("fastest as good");
    }
    const auto text = [](const Rated& r) {
        return fmt::format("{} {}{}", r.name, found_text(r),
                           r.median_ms > 0 ? fmt::format(", {:.3g} ms", r.median_ms) : "");
    };
    for (const auto& cell : results.scores) {
        const TradeoffPoint& p = cell.point;
        const auto all = rated_at(results, p);
        if (!is_choice(p) || all.empty() || all.front().median_ms == 0) continue;
        std::vector<std::string> row{fmt::format("{:g}", p.slope), std::to_string(p.photons),
                                     text(*best_of(all, Kind::light))};
        for (const Kind kind : {Kind::neighbours, Kind::reference}) {
            const Rated *best = best_of(all, kind), *fastest = fastest_as_good(all, *best);
            row.push_back(text(*best));
            row.push_back(fastest == best ? "the same" : text(*fastest));
        }
        table.rows.push_back(std::move(row));
    }
    return table;
}

// The features that are the fastest of those as good as the best, each with its number of points in the choice table.
std::string in_short(const TradeoffResults& results) {
    std::map<Kind, std::map<std::string, int>> times;
    int points = 0;
    for (const auto& cell : results.scores) {
        const TradeoffPoint& p = cell.point;
        const auto all = rated_at(results, p);
        if (!is_choice(p) || all.empty() || all.front().median_ms == 0) continue;
        ++points;
        for (const Kind kind : {Kind::neighbours, Kind::reference})
            ++times[kind][fastest_as_good(all, *best_of(all, kind))->name];
    }
    std::string text;
    for (const auto& [kind, names] : times) {
        std::vector<std::pair<int, std::string>> order;
        for (const auto& [name, count] : names) order.emplace_back(-count, name);
        std::ranges::sort(order);
        text +=
            fmt::format("- The fastest that is as good as the best {}:", kKindNames[static_cast<std::size_t>(kind)]);
        for (std::size_t k = 0; k < order.size(); ++k)
            text += fmt::format("{} {} in {} of {}", k == 0 ? "" : ",", order[k].second, -order[k].first, points);
        text += ".\n";
    }
    return text;
}

// Detection by the features of kShown at points along one axis.
Table axis_table(const TradeoffResults& results, const std::string& axis,
                 const std::vector<std::pair<std::string, TradeoffPoint>>& along) {
    Table table{{axis}, {}};
    for (const char* name : kShown) table.header.emplace_back(name);
    for (const auto& [label, point] : along) {
        const auto all = rated_at(results, point);
        if (all.empty()) continue;
        std::vector<std::string> row{label};
        for (const char* name : kShown) {
            const Rated& r = named(all, name);
            row.push_back(
                fmt::format("{}{}", found_text(r), r.median_ms > 0 ? fmt::format(", {:.3g} ms", r.median_ms) : ""));
        }
        table.rows.push_back(std::move(row));
    }
    return table;
}

std::vector<std::pair<std::string, TradeoffPoint>> along_of(
    const TradeoffResults& results, const std::function<bool(const TradeoffPoint&)>& is_on,
    const std::function<std::string(const TradeoffPoint&)>& label) {
    std::vector<std::pair<std::string, TradeoffPoint>> along;
    for (const auto& cell : results.scores) {
        if (is_on(cell.point)) along.emplace_back(label(cell.point), cell.point);
    }
    std::ranges::stable_sort(along, {},
                             [](const auto& one) { return std::pair(one.second.range_mrad, one.second.source_mrad); });
    return along;
}

// A table for each axis on which more than one point was measured; empty in the quick form.
std::string axes_text(const TradeoffResults& results) {
    const auto is_axis = [](auto member) {
        return [member](const TradeoffPoint& p) {
            TradeoffPoint c = kCentre;
            c.*member = p.*member;
            return p == c;
        };
    };
    std::string axes;
    const auto add_axis =
        [&](const std::string& title, const std::string& axis, const std::function<bool(const TradeoffPoint&)>& is_on,
            const std::function<std::string(const TradeoffPoint&)>& label, const std::string& note = {}) {
            const auto along = along_of(results, is_on, label);
            if (along.size() < 2) return;
            axes += (axes.empty() ? "### " : "\n### ") + title + "\n\n" + note +
                to_markdown(axis_table(results, axis, along));
        };
    add_axis("Slope of the part", "slope", is_axis(&TradeoffPoint::slope),
             [](const TradeoffPoint& p) { return fmt::format("{:g}", p.slope); });
    const auto is_pitch = [](const TradeoffPoint& p) {
        TradeoffPoint c = kCentre;
        c.range_mrad = p.range_mrad, c.source_mrad = p.source_mrad;
        return p == c && std::abs(p.source_mrad - 0.61 * p.range_mrad / 9) < 1e-9;
    };
    add_axis(
        "Bin pitch", "pitch, mrad", is_pitch,
        [](const TradeoffPoint& p) { return fmt::format("{:g}", p.range_mrad / 9); },
        "Nine bins of this pitch, a source of 0.61 bins.\n\n");
    add_axis("Source", "radius, bins", is_axis(&TradeoffPoint::source_mrad),
             [](const TradeoffPoint& p) { return fmt::format("{:g}", p.source_mrad / 15); });
    add_axis("Light", "photons", is_axis(&TradeoffPoint::photons),
             [](const TradeoffPoint& p) { return std::to_string(p.photons); });
    add_axis(
        "Bins", "bins",
        [](const TradeoffPoint& p) {
            return p.slope == kCentre.slope && p.frames == 1 && p.stride == 1 && has_usual_optics(p) &&
                (p.photons == 200 || p.photons == 2000 || p.photons == 20000);
        },
        [](const TradeoffPoint& p) { return fmt::format("{}, {} photons", p.bins, p.photons); },
        "The strips lie where the mean deflection is about zero. With 3 and 5 bins the source then stays inside the "
        "middle bin nearly everywhere on a good part, which is the kindest case: where it\n"
        "lies on an edge between bins, few bins do worse than this. Do not choose few bins from this table alone.\n\n");
    add_axis(
        "Frames averaged", "frames",
        [](const TradeoffPoint& p) {
            return p.slope == kCentre.slope && p.bins == 9 && p.stride == 1 && has_usual_optics(p) &&
                (p.frames > 1 || p.photons <= 2000);
        },
        [](const TradeoffPoint& p) { return fmt::format("{} of {} photons", p.frames, p.photons); });
    add_axis("Stride", "stride", is_axis(&TradeoffPoint::stride),
             [](const TradeoffPoint& p) { return std::to_string(p.stride); });

    return axes;
}

// Counts and sizes of the model.
void add_model(TemplateFields& fields, const TradeoffResults& results) {
    fields["good"] = std::to_string(results.counts.good);
    fields["pose_lenslets"] = "0.1";
    fields["good_patches"] = std::to_string(results.good_patches);
    fields["defects_of_a_family"] = std::to_string(results.defects_of_a_family);
    constexpr std::array families = {"bubble", "inclusion", "haze"};
    for (std::size_t f = 0; f < families.size(); ++f) {
        fields[std::string(families[f]) + "_smallest"] = fmt::format("{:g}", kSmallest[f]);
        fields[std::string(families[f]) + "_largest"] = fmt::format("{:g}", kLargest[f]);
    }
}

void add_approximations(TemplateFields& fields, const TradeoffResults& results) {
    Table errors{{"feature", "mean", "p99"}, {}};
    for (const auto& [name, error] : results.approximations.items()) {
        errors.rows.push_back({name, fmt::format("{:.4f}", error["mean"].get<double>()),
                               fmt::format("{:.4f}", error["p99"].get<double>())});
    }
    fields["approximations"] = to_markdown(errors);
    fields["sinkhorn_pairs"] = "";
    if (const auto entropic = results.approximations.find("sinkhorn"); entropic != results.approximations.end()) {
        fields["sinkhorn_pairs"] = fmt::format("{}", (*entropic)["pairs"].get<int>());
        fields["sinkhorn_rounds"] = fmt::format("{:.0f}", (*entropic)["rounds"].get<double>());
        fields["sinkhorn_pair_us"] = fmt::format("{:.0f}", (*entropic)["pair_us"].get<double>());
        fields["exact_pair_us"] = fmt::format("{:.1f}", (*entropic)["exact_us"].get<double>());
    }
}

// -- claims

std::vector<Claim> claims_of(const TradeoffResults& results) {
    std::vector<Claim> claims;
    const auto at = [&](double slope, int photons) { return rated_at(results, {9, slope, photons, 1, 1}); };
    const auto centre = at(0.15, 2000), steep = at(1.0, 2000), dim = at(0.15, 200);
    const auto found = [](const Rated& r) { return fmt::format("{} finds {} %", r.name, found_text(r)); };
    const auto aucs = [](const Rated& r) {
        return fmt::format("{} {:.3f} / {:.3f} / {:.3f}", r.name, r.auc[0].value, r.auc[1].value, r.auc[2].value);
    };
    const Rated &emd = named(centre, "emd"), &light = named(centre, "transmission"),
                &jacobian = named(centre, "jacobian-frobenius"), &chi2 = named(centre, "chi2"),
                &reference = named(centre, "reference-chi2");
    claims.push_back(
        {"The light that is missing finds more bubbles than any gradient over neighbours",
         std::ranges::all_of(
             centre, [&](const Rated& r) { return r.kind != Kind::neighbours || r.tpr[0].value < light.tpr[0].value; }),
         found(light) + "; " + found(emd) + "; " + found(jacobian)});
    claims.push_back(
        {"Haze is told apart better by the EMD gradient than by the Jacobian, which is blind to light spread evenly",
         emd.auc[2].value > jacobian.auc[2].value, "AUC " + aucs(emd) + "; " + aucs(jacobian)});
    claims.push_back({"Chi-square over neighbours tells haze apart better than the EMD gradient",
                      chi2.auc[2].value > emd.auc[2].value, "AUC " + aucs(chi2) + "; " + aucs(emd), false});
    claims.push_back({"Chi-square against a reference finds more haze than anything over neighbours",
                      std::ranges::all_of(centre,
                                          [&](const Rated& r) {
                                              return r.kind != Kind::neighbours ||
                                                  r.tpr[2].value < reference.tpr[2].value;
                                          }),
                      found(reference) + "; " + found(chi2) + "; " + found(emd)});
    const Rated &steep_emd = named(steep, "emd"), &steep_chi2 = named(steep, "chi2"),
                &steep_reference = named(steep, "reference-chi2");
    claims.push_back(
        {"On a steep part (slope 1), chi-square over neighbours tells haze apart worse than on a flat one (0.15)",
         steep_chi2.auc[2].value < chi2.auc[2].value, "AUC " + aucs(steep_chi2) + "; flat " + aucs(chi2)});
    claims.push_back(
        {"On a steep part (slope 1), chi-square against a reference finds more inclusions and more haze than the EMD "
         "gradient, and no fewer bubbles",
         steep_reference.tpr[0].value >= steep_emd.tpr[0].value &&
             steep_reference.tpr[1].value > steep_emd.tpr[1].value &&
             steep_reference.tpr[2].value > steep_emd.tpr[2].value,
         found(steep_reference) + "; " + found(steep_emd)});
    const Rated& dim_emd = named(dim, "emd");
    claims.push_back({"With 200 photons in place of 2000, the EMD gradient finds less",
                      dim_emd.mean_tpr() < emd.mean_tpr(), found(dim_emd) + "; with 2000 " + found(emd)});
    return claims;
}

}  // namespace

Result<ExperimentReport> report_tradeoff(const TradeoffResults& results, const ExperimentOptions& options) {
    ExperimentReport report;
    if (auto done = write_csv(options.out / "tradeoff.csv", everything(results)); !done)
        return tl::unexpected(done.error());
    report.files.push_back(options.out / "tradeoff.csv");
    report.claims = claims_of(results);

    TemplateFields fields;
    add_model(fields, results);
    add_approximations(fields, results);
    const auto drawn = plot_tradeoff(results, options.out);
    if (!drawn) return tl::unexpected(drawn.error());
    report.files.insert(report.files.end(), drawn->begin(), drawn->end());

    fields["cells"] = describe_cells(results.cells);
    fields["cell_seeds"] = std::to_string(results.cells.front().found.size());
    fields["many_seeds"] = results.cells.front().found.size() > 1 ? "yes" : "";
    for (const WantedDefect& defect : cell_defects()) {
        std::string& sizes = fields["cell_sizes"];
        sizes += fmt::format("{}{} {:g} mm", sizes.empty() ? "" : ", ", defect.name(), defect.size_mm);
    }
    fields["quick"] = options.quick ? "yes" : "";
    fields["seed"] = std::to_string(options.seed);
    fields["claims"] = describe(report.claims);
    fields["fastest_as_good"] = in_short(results);
    fields["choice"] = to_markdown(choice_table(results));
    fields["centre"] = to_markdown(centre_table(rated_at(results, kCentre)));
    fields["axes"] = axes_text(results);
    report.text = fill_report("tradeoff", fields);
    return report;
}

}  // namespace hord::lab
