#include "lab/tune/tune_report.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/file_writing.h"
#include "lab/report/scatter.h"
#include "lab/report/template.h"

namespace hord::lab {

using namespace firmware;

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::vector<const MeasuredFeatureSet*> by_time(const Tuned& tuned) {
    std::vector<const MeasuredFeatureSet*> all;
    for (const MeasuredFeatureSet& measured : tuned.feature_sets) all.push_back(&measured);
    std::ranges::stable_sort(all, {}, [](const MeasuredFeatureSet* m) { return m->wall_ms; });
    return all;
}

bool is(const Tuned& tuned, const std::optional<std::size_t>& which, const MeasuredFeatureSet* measured) {
    return which && &tuned.feature_sets[*which] == measured;
}

std::string with_interval(const Estimate& e, int digits = 3) {
    return fmt::format("{:.{}f} [{:.{}f}, {:.{}f}]", e.value, digits, e.low, digits, e.high, digits);
}

// The limits as text, with the names of the features.
std::string limits_of(const algo::Recipe& r) {
    std::string text;
    const auto add = [&](const std::string& limit) { text += (text.empty() ? "" : ", ") + limit; };
    if (r.reference) add(fmt::format("reject_score {:.3g}", r.reject_score));
    if (r.reference && r.pooled_score > 0) add(fmt::format("pooled_score {:.3g}", r.pooled_score));
    if (r.gradient) add(fmt::format("{} {:.3g}", name_of(*r.gradient), limit_of_gradient(r)));
    if (r.slopes) add(fmt::format("jacobian-frobenius {:.3g}", r.frobenius_limit_bins));
    if (r.light) add(fmt::format("transmission {:.3g}", r.transmission_limit));
    return text;
}

std::string note_of(const Tuned& tuned, const MeasuredFeatureSet* m) {
    if (!m->no_limit.empty()) return "no limit";
    if (!m->fits) return "over budget";
    std::string note = is(tuned, tuned.chosen, m) ? "chosen" : "";
    if (is(tuned, tuned.best, m)) note += note.empty() ? "best" : ", best";
    return note;
}

// The feature set with the longest wait for a processor, relative to its processor time. Null on an idle machine.
const MeasuredFeatureSet* most_disturbed(const Tuned& tuned) {
    const auto waited = [](const MeasuredFeatureSet& m) { return m.wall_ms / m.processor_ms; };
    const MeasuredFeatureSet& most = *std::ranges::max_element(tuned.feature_sets, {}, waited);
    return tuned.threads == 1 && waited(most) > 1.2 ? &most : nullptr;
}

void add_choice(TemplateFields& fields, const Tuned& tuned) {
    const MeasuredFeatureSet &chosen = tuned.feature_sets[*tuned.chosen], &best = tuned.feature_sets[*tuned.best];
    const auto yes = [](bool is) { return std::string(is ? "yes" : ""); };
    fields["chosen"] = chosen.set.name();
    fields["chosen_auc"] = with_interval(chosen.auc);
    fields["chosen_ms"] = fmt::format("{:.3g}", chosen.wall_ms);
    fields["budget_ms"] = fmt::format("{:g}", tuned.budget_ms);
    fields["as_good"] = fmt::format("{}", kAsGood);
    fields["as_fast"] = fmt::format("{:g}", 100 * kAsFast);
    fields["best"] = &chosen != &best ? best.set.name() : "";
    fields["best_auc"] = with_interval(best.auc);
    fields["behind"] = with_interval(chosen.behind);
    fields["apart"] = yes(chosen.is_clearly_worse());
    std::size_t alike = 0;
    std::string& not_considered = fields["not_considered"];
    for (const MeasuredFeatureSet& m : tuned.feature_sets) {
        alike += m.fits && &m != &best && !m.is_clearly_worse() ? 1U : 0U;
        if (!m.fits && m.no_limit.empty() && m.auc.value > best.auc.value + kAsGood) {
            not_considered += fmt::format("Over the budget and better: {}, AUC {}, {:.3g} ms.\n", m.set.name(),
                                          with_interval(m.auc), m.wall_ms);
        }
        if (!m.no_limit.empty())
            not_considered += fmt::format("Without a limit, and not considered: {}: {}.\n", m.set.name(), m.no_limit);
    }
    fields["alike"] = alike == 0 ? ""
        : alike == 1             ? "1 other feature set that fits is"
                                 : fmt::format("{} other feature sets that fit are", alike);
    fields["separates"] = yes(best.auc.low >= 1);
    fields["limits"] = limits_of(chosen.recipe.recipe);
    fields["false_rejects"] = fmt::format("{:g}", 100 * tuned.false_rejects);
    fields["margin"] = fmt::format("{:g}", 100 * kMargin);
    fields["found"] = std::to_string(chosen.found);
    fields["rejected"] = chosen.rejected == 0 ? "none" : std::to_string(chosen.rejected);
    fields["one_rejected"] = yes(chosen.rejected == 1);
    fields["bound"] = algo::describe(chosen.false_rejects);
    fields["parts"] = std::to_string(tuned.parts.parts);
    fields["repeated"] = algo::describe(tuned.parts);
    fields["repeated_bad"] = algo::describe(tuned.bad_parts);
    fields["reference"] = yes(chosen.set.reference);
    fields["unregistered"] = tuned.unregistered == 0 ? ""
        : tuned.unregistered == 1                    ? "1 good frame is"
                                                     : fmt::format("{} good frames are", tuned.unregistered);
    fields["one_unregistered"] = yes(tuned.unregistered == 1);
    const MeasuredFeatureSet* disturbed = most_disturbed(tuned);
    fields["disturbed"] = disturbed != nullptr ? disturbed->set.name() : "";
    fields["disturbed_wall_ms"] = disturbed != nullptr ? fmt::format("{:.3g}", disturbed->wall_ms) : "";
    fields["disturbed_processor_ms"] = disturbed != nullptr ? fmt::format("{:.3g}", disturbed->processor_ms) : "";
}

}  // namespace

Table table_of(const Tuned& tuned) {
    Table table{{"feature set", "AUC (95 %)", "below the best (95 %)", "bad found", "good rejected", "ms a frame",
                 "ms of processor", ""},
                {}};
    for (const MeasuredFeatureSet* m : by_time(tuned)) {
        const bool limit = m->no_limit.empty();
        table.rows.push_back({m->set.name(), with_interval(m->auc), tuned.best ? with_interval(m->behind) : "-",
                              limit ? fmt::format("{} of {}", m->found, tuned.bad) : "-",
                              limit ? fmt::format("{} of {}", m->rejected, tuned.good) : "-",
                              fmt::format("{:.3g}", m->wall_ms), fmt::format("{:.3g}", m->processor_ms),
                              note_of(tuned, m)});
    }
    return table;
}

Table numbers_of(const Tuned& tuned) {
    Table table{{"feature_set", "auc", "auc_low", "auc_high", "behind", "behind_low", "behind_high", "bad_found", "bad",
                 "good_rejected", "good", "wall_ms", "processor_ms", "fits", "chosen", "limits"},
                {}};
    for (const MeasuredFeatureSet* m : by_time(tuned)) {
        const auto number = [](double v) { return fmt::format("{:.6g}", v); };
        table.rows.push_back({m->set.name(), number(m->auc.value), number(m->auc.low), number(m->auc.high),
                              number(m->behind.value), number(m->behind.low), number(m->behind.high),
                              std::to_string(m->found), std::to_string(tuned.bad), std::to_string(m->rejected),
                              std::to_string(tuned.good), number(m->wall_ms), number(m->processor_ms),
                              m->fits ? "1" : "0", is(tuned, tuned.chosen, m) ? "1" : "0",
                              m->no_limit.empty() ? limits_of(m->recipe.recipe) : ""});
    }
    return table;
}

namespace {

// Shares with 95 % confidence; `by_tail` is null where no distribution fits.
Json bound_of(const algo::FalseRejects& r) {
    return {{"parts", r.parts},
            {"rejected", r.rejected},
            {"at_most", r.bound()},
            {"at_most_by_any", r.any},
            {"at_most_by_tail", r.tail ? Json(*r.tail) : Json()}};
}

}  // namespace

Json to_json(const Tuned& tuned) {
    const algo::Extents& e = tuned.extents;
    const auto estimate = [](const Estimate& v) { return Json{{"value", v.value}, {"low", v.low}, {"high", v.high}}; };
    Json sets = Json::array(), left_out = Json::array();
    for (const MeasuredFeatureSet* m : by_time(tuned)) {
        Json one{{"feature_set", m->set.name()},
                 {"auc", estimate(m->auc)},
                 {"behind_best", estimate(m->behind)},
                 {"ms", {{"wall", m->wall_ms}, {"processor", m->processor_ms}}},
                 {"fits", m->fits}};
        if (m->no_limit.empty())
            one.update(Json{{"bad_found", m->found},
                            {"good_rejected", m->rejected},
                            {"false_rejects", bound_of(m->false_rejects)},
                            {"limits", limits_of(m->recipe.recipe)}});
        else one["no_limit"] = m->no_limit;
        sets.push_back(std::move(one));
    }
    for (const LeftOut& out : tuned.left_out) left_out.push_back({{"file", out.file}, {"why", out.why}});
    return {{"grid", {{"m", e.m}, {"n", e.n}, {"i", e.i}, {"j", e.j}}},
            {"bits", tuned.bits},
            {"threads", tuned.threads},
            {"good", tuned.good},
            {"good_parts", tuned.parts.parts},
            {"bad_parts", tuned.bad_parts.parts},
            {"bad", tuned.bad},
            {"budget_ms", tuned.budget_ms},
            {"best", tuned.best ? Json(tuned.feature_sets[*tuned.best].set.name()) : Json()},
            {"chosen", tuned.chosen ? Json(tuned.feature_sets[*tuned.chosen].set.name()) : Json()},
            {"feature_sets", sets},
            {"left_out", left_out}};
}

std::string describe(const Tuned& tuned) {
    const algo::Extents& e = tuned.extents;
    TemplateFields fields{{"good", std::to_string(tuned.good)},
                          {"bad", std::to_string(tuned.bad)},
                          {"m", std::to_string(e.m)},
                          {"n", std::to_string(e.n)},
                          {"i", std::to_string(e.i)},
                          {"j", std::to_string(e.j)},
                          {"bits", std::to_string(tuned.bits)},
                          {"threads", fmt::format("{} thread{}", tuned.threads, tuned.threads == 1 ? "" : "s")},
                          {"chosen", ""}};
    if (tuned.chosen) add_choice(fields, tuned);
    return fill_report("tune", fields);
}

std::string recipe_text(const Tuned& tuned, const std::string& made) {
    std::string comment;
    const std::string lines =
        made + "\n" + describe(tuned) + "The same frames give the same recipe again, apart from the times measured.";
    for (std::size_t from = 0;
         from < lines.size();) {  // every line becomes a comment, also with a newline in a folder's name
        const std::size_t end = std::min(lines.find('\n', from), lines.size());
        comment += "# ";
        for (const char c : lines.substr(from, end - from))
            comment += static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) >= 0x7F ? '?' : c;
        comment += '\n';
        from = end + 1;
    }
    return comment + "\n" + format_recipe(tuned.feature_sets[*tuned.chosen].recipe);
}

Result<std::vector<std::filesystem::path>> plot_tuned(const Tuned& tuned, const std::filesystem::path& folder,
                                                      const std::string& name) {
    const auto all = by_time(tuned);
    double least = 1;
    for (const MeasuredFeatureSet* m : all) least = std::min(least, m->auc.value);
    const double shortest = std::min(all.front()->wall_ms, tuned.budget_ms),
                 longest = std::max(all.back()->wall_ms, tuned.budget_ms);
    const Scatter::Axis times{0.7 * shortest, 1.6 * longest, true},
        areas{std::max(0.0, least - 0.15 * (1 - least) - 0.02), 1 + 0.15 * (1 - least) + 0.02, false};
    Scatter scatter(times, areas);
    std::string front, intervals;
    double most = areas.low;
    for (const MeasuredFeatureSet* m : all) {
        const int kind = is(tuned, tuned.chosen, m) ? 2 : m->set.reference ? 1 : 0;
        scatter.add(m->wall_ms, m->auc.value, m->set.name(), kind);
        intervals += fmt::format("{} {} {} {}\n", m->wall_ms, m->auc.value, m->auc.low, m->auc.high);
        if (m->auc.value <= most) continue;
        front += fmt::format("{} {}\n{} {}\n", m->wall_ms, most, m->wall_ms, m->auc.value);
        most = m->auc.value;
    }
    front += fmt::format("{} {}\n", times.high, most);
    const std::string script = "$front << EOD\n" + front + "EOD\n$intervals << EOD\n" + intervals + "EOD\n" +
        scatter.script() +
        fmt::format("set xlabel 'ms a frame, {} thread{}'\nset ylabel 'area under the ROC curve, bars 95 %'\nset "
                    "grid\n",
                    tuned.threads, tuned.threads == 1 ? "" : "s") +
        fmt::format("set title 'Time and detection: {} good and {} bad frames of {}x{} lenslets'\n", tuned.good,
                    tuned.bad, tuned.extents.m, tuned.extents.n) +
        fmt::format("set arrow from {0},graph 0 to {0},graph 1 nohead lw 2 dt 2 lc rgb '#d62728'\n", tuned.budget_ms) +
        "plot $front using 1:2 with lines lc rgb '#888888' title 'nothing is faster and better', "
        "$intervals using 1:2:3:4 with yerrorbars pt 0 lw 0.5 lc rgb '#aaaaaa' notitle, "
        "$points using ($3==0?$1:1/0):2 with points pt 7 lc rgb '#1f77b4' title 'by itself', "
        "$points using ($3==1?$1:1/0):2 with points pt 5 lc rgb '#9467bd' title 'against a reference', "
        "$points using ($3==2?$1:1/0):2 with points pt 9 ps 2 lc rgb '#2ca02c' title 'chosen', "
        "NaN with lines lw 2 dt 2 lc rgb '#d62728' title 'budget'\n";
    return plot(folder, name, script, Scatter::kWidth, Scatter::kHeight);
}

Result<std::vector<fs::path>> write_report(Tuned& tuned, const fs::path& out, const std::string& made) {
    const fs::path folder = out.has_parent_path() ? out.parent_path() : fs::path(".");
    const std::string name = out.stem().string() + ".tune";
    const fs::path table = folder / (name + ".md"), numbers = folder / (name + ".csv");
    std::vector<fs::path> written{out, table, numbers};
    std::string text = "# Which features judge these parts\n\n" + made + "\n\n";
    std::istringstream lines(describe(tuned));
    for (std::string line; std::getline(lines, line);) text += "- " + line + "\n";
    text += "\n" + to_markdown(table_of(tuned)) + fmt::format("\n![time and detection]({}.png)\n", name);
    if (auto done = common::write_durably(table, text); !done) return tl::unexpected(done.error());
    if (auto done = write_csv(numbers, numbers_of(tuned)); !done) return tl::unexpected(done.error());
    if (const auto drawn = plot_tuned(tuned, folder, name)) written.insert(written.end(), drawn->begin(), drawn->end());
    else print_message("hordctl: the plot is not drawn: {}\n", drawn.error().message());
    fs::path& reference = tuned.feature_sets[*tuned.chosen].recipe.reference_file;
    std::error_code error;
    if (!reference.empty() && fs::equivalent(reference.parent_path(), folder, error)) reference = reference.filename();
    if (auto done = common::write_durably(out, recipe_text(tuned, made)); !done) return tl::unexpected(done.error());
    return written;
}

}  // namespace hord::lab
