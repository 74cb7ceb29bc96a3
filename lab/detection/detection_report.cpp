// The detection experiment's report: a function for each section of docs/results/templates/detection.md.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include <fmt/format.h>

#include "algo/verdict/verdict.h"
#include "lab/detection/detection.h"
#include "lab/detection/detection_parts.h"
#include "lab/detection/detection_plots.h"
#include "lab/detection/detection_statistics.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

std::string percent(const Estimate& e) {
    return fmt::format("{:.2f} % ({:.2f} to {:.2f})", 100 * e.value, 100 * e.low, 100 * e.high);
}
std::string interval(const Estimate& e, int digits) {
    return fmt::format("{:.{}f} ({:.{}f} to {:.{}f})", e.value, digits, e.low, digits, e.high, digits);
}
std::string size(const std::optional<double>& value) { return value ? fmt::format("{:.2f}", *value) : "none"; }

// How a criterion is decided. The quick form has too few parts for some criteria; a time is not a claim.
enum class DecidedBy : std::uint8_t { many_parts, few_parts, the_machine };

struct Criterion {
    std::string what, least, aim, measured;
    bool reached_least, reached_aim;
    bool finished = true;
    DecidedBy decided_by = DecidedBy::many_parts;
};

struct Report {
    const DetectionResults& results;
    std::vector<Criterion> criteria;
    TemplateFields fields;
};

constexpr std::array kGoodFigures = {"still", "wobble", "wobble, LED 70 %"};

bool good_parts_finished(const DetectionResults& r) {
    return std::ranges::all_of(kGoodFigures, [&](const char* figure) { return is_finished(r, figure); });
}

void report_false_rejects_and_bubbles(Report& report) {
    const DetectionResults& r = report.results;
    Table rejects{{"good parts", "parts", "rejected", "of that unfit", "share (95 %)"}, {}};
    double most_false = 0;
    for (const char* name : kGoodFigures) {
        const Parts& parts = parts_of(r, name);
        const double k = share_above(parts, 1) * static_cast<double>(parts.size());
        rejects.rows.push_back({name, fmt::format("{}", parts.size()), fmt::format("{:.0f}", k),
                                fmt::format("{}", std::ranges::count_if(parts, &JudgedPart::unfit)),
                                percent(share_of(k, static_cast<double>(parts.size())))});
        most_false = std::max(most_false, share_above(parts, 1));
    }
    const Parts& bubbles = parts_of(r, "bubble");
    const PodCurve pod = pod_of(bubbles, r.bubble_exposures, 0), near = pod_of(bubbles, r.bubble_exposures, 2);
    const bool quiet = most_false <= 1e-3;
    report.criteria.push_back(
        {"bubble found with 90 % probability at 95 % confidence (a90/95), at <= 0.1 % false rejects",
         "radius 1 lenslet", "0.5",
         fmt::format("a90/95 {} lenslets (a50 {}, a90 {}); at most {:.2f} % of the good parts rejected",
                     size(pod.a90_95), size(pod.a50), size(pod.a90), 100 * most_false),
         quiet && pod.a90_95 && *pod.a90_95 <= 1, quiet && pod.a90_95 && *pod.a90_95 <= 0.5,
         is_finished(r, "bubble") && good_parts_finished(r)});
    double small = 0, small_found = 0;
    for (const JudgedPart& p : bubbles) {
        if (p.size >= 0.3) continue;
        small += 1, small_found += p.score >= 1 && p.hit ? 1 : 0;
    }
    TemplateFields& fields = report.fields;
    fields["false_rejects"] = to_markdown(rejects);
    fields["good_share"] = fmt::format("{:.2f}", 100 * kGoodShare);
    fields["most_false"] = fmt::format("{:.2f}", 100 * most_false);
    fields["a90_95_away_from_rim"] = size(near.a90_95);
    fields["a90_95"] = size(pod.a90_95);
    fields["small"] = fmt::format("{:.0f}", small);
    fields["small_found"] = fmt::format("{:.0f}", small > 0 ? 100 * small_found / small : 0.0);
}

// The cut between the lenslets: the rows of its table, and the claim.
void report_cut_places(Report& report, const std::vector<PlaceContrast>& places) {
    Table table{{"right of and below a lenslet's middle, lenslets", "seed", "EMD gradient", "here",
                 "here / EMD gradient", "surest possible", "here / surest possible"},
                {}};
    int above_surest = 0;
    for (const PlaceContrast& p : places) {
        const bool missed = !contrast_claim({p}).holds();
        table.rows.push_back({fmt::format("{:.2f}, {:.2f}", p.m, p.n), std::to_string(p.seed),
                              fmt::format("{:.1f}", p.emd), fmt::format("{:.1f}", p.score),
                              fmt::format("{:.1f}x", p.score / std::max(p.emd, 1.0)), fmt::format("{:.1f}", p.surest),
                              fmt::format("{:.2f}{}", p.score / std::max(p.surest, 1.0), missed ? " **no**" : "")});
        above_surest += p.score > p.surest ? 1 : 0;
    }
    const ContrastClaim claim = contrast_claim(places);
    const auto text = [](const ContrastClaim::Spread& s) {
        return fmt::format("{:.2f} at the least, {:.2f} at the median, {:.2f} at the most", s.least, s.median, s.most);
    };
    const std::string of_surest = text(claim.of_surest), over_emd = text(claim.over_emd);
    report.criteria.push_back(
        {fmt::format("the cut at 16 places between the lenslets, {} seeds: contrast over the surest possible, at every "
                     "one; and over the EMD gradient's wherever the surest possible reaches it",
                     kContrastSeeds),
         fmt::format("{}; {}x", kOfSurest, kOverEmd), "the same",
         fmt::format("over the surest possible {}, too low at {} of {}; over the EMD gradient {}, too low at {} of the "
                     "{} within reach",
                     of_surest, claim.below_surest.size(), places.size(), over_emd, claim.below_emd.size(),
                     places.size() - claim.beyond_reach),
         claim.holds(), claim.holds(), places.size() == std::size_t{16} * kContrastSeeds, DecidedBy::few_parts});
    TemplateFields& fields = report.fields;
    fields["places_table"] = to_markdown(table);
    fields["places"] = std::to_string(places.size());
    fields["contrast_seeds"] = std::to_string(kContrastSeeds);
    fields["of_surest"] = of_surest;
    fields["over_emd"] = over_emd;
    fields["places_low"] = claim.below_surest.empty() ? "" : std::to_string(claim.below_surest.size());
    fields["beyond_reach"] = claim.beyond_reach > 0 ? std::to_string(claim.beyond_reach) : "";
    fields["least_surest_ratio"] = fmt::format("{:.2f}", claim.least_surest_over_emd);
    fields["places_above_surest"] = above_surest > 0 ? std::to_string(above_surest) : "";
}

void report_contrast(Report& report) {
    Table scenes{{"scene", "radius, lenslets", "EMD gradient", "EMD gradient, dark lenslets taken as evenly lit",
                  "here", "here / EMD gradient", "surest possible", "surest possible / EMD gradient",
                  "averaged over the defect: EMD gradient", "dark evenly lit", "here", "here / EMD gradient"},
                 {}};
    std::vector<PlaceContrast> places;
    std::string measured;
    double least_ratio = 1e9, cut_emd = 0, cut_surest = 0;
    for (const Json& scene : report.results.contrast) {
        const auto median = [&](const char* how, const char* map) {
            return quantile(scene[how][map].get<std::vector<double>>(), 0.5);
        };
        // Contrasts below one sigma count as one.
        const auto over = [](double here, double emd) { return here / std::max(emd, 1.0); };
        const auto name = scene["scene"].get<std::string>();
        if (scene["each"].is_null() || scene["each"].empty()) continue;  // every exposure was unfit
        const double emd = median("each", "emd"), z_score = median("each", "z-score"), ratio = over(z_score, emd);
        const double surest = median("each", "surest"), surest_ratio = over(surest, emd);
        if (name == "cut beside") {
            places.push_back({scene["beside"][0].get<double>(), scene["beside"][1].get<double>(),
                              scene["seed"].get<std::uint64_t>(), emd, z_score, surest});
            continue;
        }
        if (name == "cut") cut_emd = emd, cut_surest = surest;
        if (name == "cut" || name == "bubble") {
            least_ratio = std::min(least_ratio, ratio);
            measured +=
                fmt::format("{}{}: {:.1f}x (EMD gradient {:.1f}, here {:.1f} clean sigmas, median of {} exposures)",
                            measured.empty() ? "" : "; ", name, ratio, emd, z_score, scene["each"]["emd"].size());
        }
        const double emd_averaged = median("averaged", "emd"), z_averaged = median("averaged", "z-score");
        scenes.rows.push_back({name, fmt::format("{:.1f}", scene["radius"].get<double>()), fmt::format("{:.1f}", emd),
                               fmt::format("{:.1f}", median("each", "even")), fmt::format("{:.1f}", z_score),
                               fmt::format("{:.1f}x", ratio), fmt::format("{:.1f}", surest),
                               fmt::format("{:.1f}x", surest_ratio), fmt::format("{:.0f}", emd_averaged),
                               fmt::format("{:.0f}", median("averaged", "even")), fmt::format("{:.0f}", z_averaged),
                               fmt::format("{:.1f}x", over(z_averaged, emd_averaged))});
    }
    report.criteria.push_back(
        {"contrast-to-noise on the paper's cut and bubble scenes, against the paper's EMD gradient", "2x", "5x",
         measured, least_ratio >= 2, least_ratio >= 5, !report.results.contrast.is_null()});
    report_cut_places(report, places);
    TemplateFields& fields = report.fields;
    fields["contrast_table"] = report.results.contrast.is_null() ? "" : to_markdown(scenes);
    fields["missing_light_sigmas"] = fmt::format("{:.0f}", std::sqrt(2 * kProductionElectrons));
    fields["cut_emd"] = fmt::format("{:.1f}", cut_emd);
    fields["cut_surest"] = fmt::format("{:.1f}", cut_surest);
    fields["cut_surest_ratio"] = fmt::format("{:.2f}", cut_surest / std::max(cut_emd, 1.0));
}

void report_specks(Report& report) {
    const DetectionResults& r = report.results;
    const Estimate auc = roc_of(parts_of(r, "wobble"), parts_of(r, "speck"), r.poses, r.poses, r.seed).auc;
    report.criteria.push_back({"absorber of 50 % over 2 lenslets, AUC", "0.99", "0.999", interval(auc, 4),
                               auc.value >= 0.99, auc.value >= 0.999, good_parts_finished(r) && is_finished(r, "speck"),
                               DecidedBy::few_parts});
}

// Returns the points of the plot.
std::string report_slopes(Report& report) {
    const DetectionResults& r = report.results;
    Table slopes{{"slope, bins over two lenslets", "AUC (95 %)", "found at the limits", "good parts rejected"}, {}};
    double least_auc = 1, worst_share = 0, worst_slope = 0;
    bool all_finished = true;
    std::string auc_points;
    for (const double slope : r.slopes) {
        const std::string good_figure = fmt::format("slope {:g} good", slope),
                          haze_figure = fmt::format("slope {:g} haze", slope);
        const Parts &good = parts_of(r, good_figure), &bad = parts_of(r, haze_figure);
        const double rejected = share_above(good, 1);
        if (rejected > worst_share) worst_share = rejected, worst_slope = slope;
        all_finished = all_finished && is_finished(r, good_figure) && is_finished(r, haze_figure);
        if (good.empty() || bad.empty()) continue;
        const Estimate auc = roc_of(good, bad, r.slope_poses, r.slope_poses, r.seed).auc;
        least_auc = std::min(least_auc, auc.value);
        slopes.rows.push_back({fmt::format("{:g}", slope), interval(auc, 4),
                               fmt::format("{:.1f} %", 100 * share_above(bad, 1)),
                               fmt::format("{:.2f} %", 100 * rejected)});
        auc_points += fmt::format("{} {} {} {}\n", slope, auc.value, auc.low, auc.high);
    }
    report.criteria.push_back({"AUC at every object slope 0.05 to 1.5, 10 % spread defect at 2,000 e-", "0.98", "0.99",
                               fmt::format("least {:.4f}", least_auc), least_auc >= 0.98, least_auc >= 0.99,
                               all_finished});
    report.fields["slopes"] = to_markdown(slopes);
    report.fields["worst_strips"] = worst_share > 1e-3 ? fmt::format("{:.2f}", 100 * worst_share) : "";
    report.fields["worst_slope"] = fmt::format("{:g}", worst_slope);
    return auc_points;
}

void report_light_levels(Report& report) {
    const DetectionResults& r = report.results;
    Table levels{{"electrons a lenslet", "good parts rejected at the same limits (95 %)", "haze found at them",
                  "haze, AUC (95 %)"},
                 {}};
    TemplateFields& fields = report.fields;
    fields["few_electrons"] = "";
    for (const double electrons : kLightLevels) {
        const Parts &good = parts_of(r, fmt::format("{:g} electrons good", electrons)),
                    &bad = parts_of(r, fmt::format("{:g} electrons haze", electrons));
        if (good.empty() || bad.empty()) continue;
        const auto count = static_cast<double>(good.size());
        const Estimate auc = roc_of(good, bad, r.poses, r.poses, r.seed).auc;
        const std::string haze_found = fmt::format("{:.1f}", 100 * share_above(bad, 1));
        levels.rows.push_back({fmt::format("{:g}", electrons), percent(share_of(share_above(good, 1) * count, count)),
                               haze_found + " %", interval(auc, 4)});
        if (electrons != kLightLevels[0]) continue;
        fields["few_electrons"] = fmt::format("{:g}", electrons);
        fields["few_found"] = haze_found;
        fields["few_good"] = fmt::format("{:.1f}", 100 * share_above(good, 1));
        fields["few_auc"] = fmt::format("{:.2f}", auc.value);
        fields["few_haze_electrons"] = fmt::format("{:g}", electrons / 10);
    }
    fields["light_levels"] = to_markdown(levels);
}

void report_wobble(Report& report) {
    const DetectionResults& r = report.results;
    const Parts& still = parts_of(r, "still");
    const Estimate by_wobble = ratio_of_rejects(still, parts_of(r, "wobble"), r.seed),
                   by_both = ratio_of_rejects(still, parts_of(r, "wobble, LED 70 %"), r.seed);
    const double most_ratio = std::max(by_wobble.value, by_both.value);
    report.criteria.push_back({"false rejects with +-0.5 lenslet, +-1 degree pose wobble, 30 % LED loss", "2x of still",
                               "1.2x",
                               fmt::format("wobble {}x, with 30 % LED loss {}x, where still parts have 5 %",
                                           interval(by_wobble, 2), interval(by_both, 2)),
                               most_ratio <= 2, most_ratio <= 1.2, good_parts_finished(r)});
}

void report_kinds(Report& report) {
    using algo::DefectKind;
    constexpr std::array<const char*, 5> figures = {"speck", "haze", "dimple", "scratch", "bubble"};
    // By figure, in the same order; no kind is correct for a bubble.
    constexpr std::array<DefectKind, 4> right_kinds = {DefectKind::absorbing, DefectKind::scattering,
                                                       DefectKind::surface, DefectKind::scratch};
    Table kinds{
        {"flaw", "parts", "found", "called scattering", "absorbing", "surface", "scratch", "unknown", "rightly"}, {}};
    double right_shares = 0;
    bool all_finished = true;
    for (std::size_t f = 0; f < figures.size(); ++f) {
        const Parts& parts = parts_of(report.results, figures[f]);
        all_finished = all_finished && is_finished(report.results, figures[f]);
        if (parts.empty()) continue;
        std::array<double, 5> counts{};
        double found = 0;
        for (const JudgedPart& p : parts) {
            if (p.score < 1 || !p.hit || p.kind < 0) continue;
            ++counts[static_cast<std::size_t>(p.kind)], ++found;
        }
        const bool has_right_kind = f < right_kinds.size();
        const double right = has_right_kind && found > 0 ? counts[static_cast<std::size_t>(right_kinds[f])] / found : 0;
        right_shares += right / static_cast<double>(right_kinds.size());
        std::vector<std::string> row{figures[f], fmt::format("{}", parts.size()),
                                     fmt::format("{:.1f} %", 100 * found / static_cast<double>(parts.size()))};
        for (const DefectKind kind : {DefectKind::scattering, DefectKind::absorbing, DefectKind::surface,
                                      DefectKind::scratch, DefectKind::unknown}) {
            const double count = counts[static_cast<std::size_t>(kind)];
            row.push_back(fmt::format("{:.1f} %", found > 0 ? 100 * count / found : 0.0));
        }
        row.push_back(has_right_kind ? fmt::format("{:.1f} %", 100 * right) : "-");
        kinds.rows.push_back(std::move(row));
    }
    report.criteria.push_back({"kind named rightly (mean of the four kinds, of those found)", "90 %", "97 %",
                               fmt::format("{:.1f} %", 100 * right_shares), right_shares >= 0.9, right_shares >= 0.97,
                               all_finished, DecidedBy::few_parts});
    report.fields["kinds"] = to_markdown(kinds);
}

void report_times(Report& report) {
    const Json& times = report.results.times;
    if (times.is_null()) return;
    const auto number = [&](const char* key) { return times[key].get<double>(); };
    const double added = number("added");
    report.criteria.push_back(
        {"time added to the features at paper size", "50 %", "20 %",
         fmt::format("{:.0f} % (a tenth of the runs below {:.0f}, a tenth above {:.0f}) of {:.1f} ms of features, {} "
                     "lenslets squared, CPU time of one thread, with and without in turns, median of {}",
                     100 * added, 100 * number("added_low"), 100 * number("added_high"), number("features"),
                     times["lenslets"].get<int>(), times["repeats"].get<int>()),
         added <= 0.5, added <= 0.2, true, DecidedBy::the_machine});
}

void report_production(Report& report, const ExperimentOptions& options) {
    const DetectionResults& r = report.results;
    TemplateFields& fields = report.fields;
    fields["seed"] = std::to_string(options.seed);
    fields["arguments"] = options.arguments();
    fields["quick"] = options.quick ? "yes" : "";
    fields["tuned_on"] = r.tuned_on > 0 ? std::to_string(r.tuned_on) : "";
    fields["limits"] = r.tuned_on > 0 ? "tuned limits" : "the recipe's limits";
    fields["factor"] = fmt::format("{:.2f}", r.factor);
    fields["reject_score"] = fmt::format("{:.1f}", static_cast<double>(production_recipe().reject_score) * r.factor);
    fields["cluster_score"] = fmt::format("{:.1f}", static_cast<double>(production_recipe().cluster_score) * r.factor);
    fields["poses"] = std::to_string(r.poses);
    fields["slope_poses"] = std::to_string(r.slope_poses);
    fields["bubble_exposures"] = std::to_string(r.bubble_exposures);
    fields["flaw_exposures"] = std::to_string(r.flaw_exposures);
    std::string& unfinished = fields["unfinished"];
    for (const auto& [name, all] : r.wanted) {
        const std::size_t judged = parts_of(r, name).size();
        if (judged < all) unfinished += fmt::format("- {}: {} of {} parts.\n", name, judged, all);
    }
}

// The criteria as a table, and those that are decided as claims.
Table decide(const std::vector<Criterion>& criteria, bool quick, std::vector<Claim>& claims) {
    Table table{{"", "at least", "aim", "measured", "reached"}, {}};
    for (const Criterion& c : criteria) {
        const bool too_few = quick && c.decided_by == DecidedBy::many_parts;
        table.rows.push_back({c.what, c.least, c.aim, c.measured,
                              !c.finished           ? "not finished"
                                  : too_few         ? "too few parts"
                                  : c.reached_aim   ? "the aim"
                                  : c.reached_least ? "the least"
                                                    : "**no**"});
        if (!c.finished)
            claims.push_back(
                {c.what + ": " + c.least, std::nullopt, "the run was interrupted before this was finished"});
        else if (!too_few && c.decided_by != DecidedBy::the_machine)
            claims.push_back({c.what + ": " + c.least, c.reached_least, c.measured});
    }
    return table;
}

}  // namespace

Result<ExperimentReport> report_detection(const DetectionResults& r, const ExperimentOptions& options) {
    Report report{r, {}, {}};
    report_production(report, options);
    report_false_rejects_and_bubbles(report);
    report_contrast(report);
    report_specks(report);
    const std::string auc_points = report_slopes(report);
    report_light_levels(report);
    report_wobble(report);
    report_kinds(report);
    report_times(report);

    ExperimentReport done;
    const Table criteria = decide(report.criteria, options.quick, done.claims);
    if (auto written = write_csv(options.out / "detection.csv", criteria); !written)
        return tl::unexpected(written.error());
    done.files.push_back(options.out / "detection.csv");
    struct Plot {
        std::string name, script;  // empty script: an interrupted run has no parts for it
    };
    const bool any_bubbles = !parts_of(r, "bubble").empty(),
               any_roc = !parts_of(r, "wobble").empty() && !parts_of(r, "speck").empty();
    for (const Plot& wanted :
         {Plot{"detection-pod", any_bubbles ? pod_script(r) : ""}, Plot{"detection-roc", any_roc ? roc_script(r) : ""},
          Plot{"detection-slopes", auc_points.empty() ? "" : slope_script(auc_points)}}) {
        report.fields[wanted.name] = wanted.script.empty() ? "" : wanted.name;
        if (wanted.script.empty()) continue;
        auto drawn = plot(options.out, wanted.name, wanted.script);
        if (!drawn) return tl::unexpected(drawn.error());
        done.files.insert(done.files.end(), drawn->begin(), drawn->end());
    }
    report.fields["criteria"] = to_markdown(criteria);
    report.fields["claims"] = describe(done.claims);
    done.text = fill_report("detection", report.fields);
    return done;
}

}  // namespace hord::lab
