#include "firmware/diagnostics/learn_report.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/file_writing.h"
#include "common/statistics.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/store/results/export.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

using store::Json;

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kModes = 3;
constexpr int kSchema = 1;  // of the JSON

// A map of one channel: from 0 up, or symmetric about 0.
Picture picture_of(const std::string& title, const std::string& unit, const std::vector<float>& map,
                   const algo::Variation& variation, bool symmetric) {
    std::vector<double> sizes;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if (variation.mask[k] == algo::kValid) sizes.push_back(std::abs(static_cast<double>(map[k])));
    }
    const auto high = static_cast<float>(std::max(common::quantile(std::move(sizes), 0.99), 1e-4));
    MapPicture what{.title = title, .unit = unit, .low = symmetric ? -high : 0.0F, .high = high};
    what.no_value = algo::kDark;
    return draw(what, map, variation.mask, variation.grid, {});
}

MontageRow row_of(const std::string& label, const algo::PartMapSet& maps, const algo::Variation& v, bool symmetric,
                  bool light_symmetric) {
    return {label,
            {picture_of("light", "typical = 1", maps.light, v, light_symmetric),
             picture_of("deflection x", "bins", maps.x, v, symmetric),
             picture_of("deflection y", "bins", maps.y, v, symmetric)}};
}

Picture pictures_of(const algo::Variation& v) {
    std::vector<MontageRow> rows{row_of("mean", v.mean, v, true, false), row_of("spread", v.spread, v, false, false)};
    for (std::size_t k = 0; k < v.modes.size(); ++k)
        rows.push_back(
            row_of(fmt::format("mode {}: {:.0f} %", k + 1, 100 * v.modes[k].share), v.modes[k].maps, v, true, true));
    return montage(rows);
}

struct Row {
    std::string frame;
    std::optional<algo::Pose> pose;
    std::string left_out, judged;
    std::vector<double> amounts;
};

std::vector<Row> rows_of(const LearnReport& report) {
    std::vector<Row> rows;
    std::size_t kept = 0;
    for (std::size_t k = 0; k < report.parts.frames.size(); ++k) {
        Row row{report.parts.frames[k], report.parts.poses[k], "", "", {}};
        for (const algo::LeftOut& out : report.parts.left_out) {
            if (out.part == k) row.left_out = out.why;
        }
        for (const auto& judged : report.check.judged) {
            if (judged.frame == k)
                row.judged = judged.score >= algo::ReferenceCheck::kUnfit ? "unfit: " + judged.reason
                                                                          : fmt::format("{:.2f}", judged.score);
        }
        if (row.pose && kept < algo::VariationMeter::kMaxParts) {
            for (const algo::VariationMode& mode : report.variation.modes) row.amounts.push_back(mode.amounts[kept]);
            ++kept;
        }
        rows.push_back(std::move(row));
    }
    return rows;
}

std::string modes_text(const algo::Variation& v) {
    if (v.modes.empty()) return {};
    std::string text = fmt::format(
        "Of what varies between the {} parts in light and mean deflection, noise included, the "
        "first modes have",
        v.parts);
    for (std::size_t k = 0; k < v.modes.size(); ++k)
        text += fmt::format("{} {:.0f} %", k == 0 ? "" : ",", 100 * v.modes[k].share);
    return text + fmt::format("; noise alone would give each {:.1f} %.", 100 * v.share_by_noise());
}

std::string poses_text(const LearnReport& report) {
    double x = 0, y = 0, turn = 0;
    for (const auto& pose : report.parts.poses) {
        if (!pose) continue;
        x = std::max(x, std::abs(pose->x)), y = std::max(y, std::abs(pose->y));
        turn = std::max(turn, std::abs(pose->turn_rad()));
    }
    const auto thousandths = [](double value) { return std::round(1e3 * value) / 1e3; };
    return fmt::format(
        "The parts lay up to {:.2g} lenslets aside along x, {:.2g} along y, and up to {:.2g} degrees "
        "turned from the reference's pose.",
        thousandths(x), thousandths(y), thousandths(turn * kDegrees));
}

// The table of the parts, as Markdown and as CSV.
struct Tables {
    std::string markdown, csv;
};
Tables tables_of(const LearnReport& report) {
    std::string text = "| frame | x, lenslets | y, lenslets | turn, degrees | score by the others |";
    std::string csv = "frame,x_lenslets,y_lenslets,turn_deg,score,left_out";
    for (std::size_t k = 0; k < report.variation.modes.size(); ++k)
        text += fmt::format(" mode {} |", k + 1), csv += fmt::format(",mode_{}", k + 1);
    text += "\n|---|---|---|---|---|";
    for (std::size_t k = 0; k < report.variation.modes.size(); ++k) text += "---|";
    text += "\n", csv += "\n";
    for (const Row& row : rows_of(report)) {
        const bool left_out = !row.left_out.empty() || !row.pose;
        const algo::Pose pose = row.pose.value_or(algo::Pose{});
        text += left_out ? fmt::format("| {} | - | - | - | left out: {} |", row.frame, row.left_out)
                         : fmt::format("| {} | {:.3f} | {:.3f} | {:.3f} | {} |", row.frame, pose.x, pose.y,
                                       pose.turn_rad() * kDegrees, row.judged.empty() ? "-" : row.judged);
        csv += left_out ? fmt::format("\"{}\",,,,,\"{}\"", row.frame, row.left_out)
                        : fmt::format("\"{}\",{:.4f},{:.4f},{:.4f},\"{}\",", row.frame, pose.x, pose.y,
                                      pose.turn_rad() * kDegrees, row.judged);
        for (std::size_t k = 0; k < report.variation.modes.size(); ++k) {
            text += k < row.amounts.size() ? fmt::format(" {:.2f} |", row.amounts[k]) : " - |";
            csv += k < row.amounts.size() ? fmt::format(",{:.4f}", row.amounts[k]) : ",";
        }
        text += "\n", csv += "\n";
    }
    return {std::move(text), std::move(csv)};
}

Json json_of(const LearnReport& report, const Picture& picture, std::uint32_t picture_crc) {
    const LearnedParts& parts = report.parts;
    const algo::ReferenceCheck& check = report.check;
    const auto known = [](const std::optional<double>& value) { return value ? Json(*value) : Json(); };
    Json json{{"schema", kSchema},
              {"reference", parts.file.filename().string()},
              {"reference_crc32", fmt::format("{:08X}", crc32_of(parts.reference))},
              {"learned", store::format_utc(store::utc_now())},
              {"parts", parts.reference->parts},
              {"parts_given", parts.frames.size()}};
    json["sentences"] = json["left_out"] = json["flaws"] = json["modes"] = Json::array();
    for (const LearnSentence& told : describe(report))
        json["sentences"].push_back({{"about", told.about}, {"text", told.text}});
    for (const algo::LeftOut& out : parts.left_out)
        json["left_out"].push_back({{"frame", parts.frames[out.part]}, {"why", out.why}});
    for (const algo::VariationMode& mode : report.variation.modes) json["modes"].push_back(mode.share);
    json["not_checked"] = check.not_checked.empty() ? Json() : Json(check.not_checked);
    if (check.not_checked.empty()) {
        json["false_rejects"] = {{"parts", check.false_rejects.parts},
                                 {"rejected", check.false_rejects.rejected},
                                 {"bound", check.false_rejects.bound()},
                                 {"tail_bound", known(check.false_rejects.tail)}};
        for (std::size_t kind = 0; kind < algo::kPaintedFlaws.size(); ++kind) {
            const auto& found = check.flaws[kind];
            const auto& what = algo::kPaintedFlaws[kind];
            if (found.trials == 0) continue;
            json["flaws"].push_back({{"kind", what.name},
                                     {"size", what.size},
                                     {"unit", what.unit},
                                     {"a90", known(found.curve.a90)},
                                     {"a90_95", known(found.curve.a90_95)},
                                     {"trials", found.trials},
                                     {"found", found.found}});
        }
    }
    json["picture"] = {
        {"crc32", fmt::format("{:08X}", picture_crc)}, {"width", picture.width}, {"height", picture.height}};
    return json;
}

Result<algo::Variation> variation_of(const LearnedParts& parts) {
    algo::VariationMeter meter(*parts.reference);
    for (std::size_t k = 0, added = 0; k < parts.frames.size() && added < algo::VariationMeter::kMaxParts; ++k) {
        if (!parts.poses[k]) continue;
        const auto frame = parts.frame_of(k);
        if (!frame) return tl::unexpected(frame.error());
        meter.add(frame->view(), *parts.poses[k]);
        ++added;
    }
    return meter.finish(kModes);
}

}  // namespace

Result<LearnReport> check_learned(const LearnedParts& parts, std::size_t trials,
                                  const std::function<void(double)>& progress) {
    const algo::Reference& reference = *parts.reference;
    const std::size_t count = parts.frames.size();
    LearnReport report{parts, {}, {}};
    auto variation = variation_of(parts);
    if (!variation) return tl::unexpected(variation.error());
    report.variation = std::move(*variation);

    algo::CheckOptions options;
    options.learning = parts.learning;
    options.learning.electrons_per_dn = reference.sensor.electrons_per_dn;
    options.recipe = parts.recipe;
    options.recipe.reference.reset();
    options.trials = trials;
    options.progress = progress;
    std::vector<std::size_t> part_of(count);
    std::iota(part_of.begin(), part_of.end(), std::size_t{0});
    std::vector<bool> used(count, true);
    for (const algo::LeftOut& out : parts.left_out) used[out.part] = false;
    std::optional<Error> no_frame;
    const auto frame_of = [&](std::size_t k) {
        auto frame = parts.frame_of(k);
        if (!frame) no_frame = frame.error();
        return frame;
    };
    auto check = algo::check_reference(reference.extents, reference.bits, count, frame_of, part_of, used, options);
    if (no_frame) return tl::unexpected(*no_frame);
    if (check) report.check = std::move(*check);
    else report.check.not_checked = check.error().what;
    return report;
}

std::string summary_of(const LearnedParts& parts) {
    const algo::Reference& r = *parts.reference;
    return fmt::format(
        "{}: {}x{} lenslets of {}x{} bins, {} of {} parts, {} {:.3g} electrons a DN, {} read noise {:.2g} DN",
        parts.file.string(), r.extents.m, r.extents.n, r.extents.i, r.extents.j, r.parts, parts.frames.size(),
        parts.electrons_from, r.sensor.electrons_per_dn, parts.read_noise_from, r.sensor.read_dn);
}

std::vector<LearnSentence> describe(const LearnReport& report) {
    const LearnedParts& parts = report.parts;
    std::vector<LearnSentence> told;
    const auto tell = [&](std::string_view about, std::string text) { told.push_back({about, std::move(text)}); };
    for (const std::string& unsure : parts.unsure) tell("parts", unsure + ".");
    if (!parts.repeated.empty()) tell("parts", parts.repeated);
    for (const algo::LeftOut& out : parts.left_out)
        tell("left-out", fmt::format("Left out: {}: {}.", parts.frames[out.part], out.why));
    tell("variation", poses_text(report));
    if (const std::string modes = modes_text(report.variation); !modes.empty()) tell("variation", modes);
    const algo::CheckSentences check = algo::describe(report.check, parts.recipe, parts.frames);
    for (const std::string& text : check.judged) tell("false-rejects", text);
    for (const std::string& text : check.false_rejects) tell("false-rejects", text);
    for (const std::string& text : check.flaws) tell("flaws", text);
    return told;
}

Result<std::vector<fs::path>> write_learn_report(const LearnReport& report) {
    const LearnedParts& parts = report.parts;
    std::vector<fs::path> files;
    for (const std::string_view ending : kReportEndings) files.push_back(report_file(parts.file, ending));
    const Picture drawn = pictures_of(report.variation);
    const auto picture = encode_png(drawn);
    if (!picture) return tl::unexpected(picture.error());
    const Tables tables = tables_of(report);
    std::string text =
        fmt::format("# What was learned: {}\n\n- {}.\n", parts.file.filename().string(), summary_of(parts));
    for (const LearnSentence& told : describe(report)) text += "- " + told.text + "\n";
    text += fmt::format(
        "\n![mean, spread and modes]({})\n\nMean, spread (standard deviation between the parts, noise "
        "included) and modes (what changes at one standard deviation of the mode) of the parts at the "
        "reference's pose{}.\n\n{}",
        files[0].filename().string(),
        report.variation.step > 1
            ? fmt::format(", every {}th lenslet of every {}th row", report.variation.step, report.variation.step)
            : "",
        tables.markdown);
    const std::string_view bytes(reinterpret_cast<const char*>(picture->data()), picture->size());
    const std::string contents[] = {std::string(bytes), tables.csv, std::move(text),
                                    store::to_text(json_of(report, drawn, common::crc32(bytes)), 1) + "\n"};
    for (std::size_t k = 0; k < files.size(); ++k) {
        if (auto done = common::write_durably(files[k], contents[k]); !done) return tl::unexpected(done.error());
    }
    return files;
}

}  // namespace hord::firmware
