#include "firmware/hordctl/frames/learn_report.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "common/file_writing.h"
#include "common/statistics.h"
#include "firmware/diagnostics/map_images.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

constexpr double kDegrees = 180 / std::numbers::pi;

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
            {picture_of("light", "of the typical lenslet", maps.light, v, light_symmetric),
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
    for (std::size_t k = 0; k < report.frames.size(); ++k) {
        Row row{report.frames[k], report.learned.poses[k], "", "", {}};
        for (const algo::LeftOut& out : report.learned.left_out) {
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
    for (const auto& pose : report.learned.poses) {
        if (!pose) continue;
        x = std::max(x, std::abs(pose->x)), y = std::max(y, std::abs(pose->y));
        turn = std::max(turn, std::abs(pose->turn_rad()));
    }
    return fmt::format(
        "The parts lay up to {:.2g} lenslets aside along x, {:.2g} along y, and up to {:.2g} degrees "
        "turned from the reference's pose.",
        x, y, turn * kDegrees);
}

}  // namespace

std::vector<std::string> describe(const LearnReport& report) {
    std::vector<std::string> lines{report.summary + "."};
    if (!report.distinct.empty()) lines.push_back(report.distinct);
    for (const algo::LeftOut& out : report.learned.left_out)
        lines.push_back(fmt::format("Left out: {}: {}.", report.frames[out.part], out.why));
    lines.push_back(poses_text(report));
    if (const std::string modes = modes_text(report.variation); !modes.empty()) lines.push_back(modes);
    for (std::string& line : algo::describe(report.check, report.recipe)) lines.push_back(std::move(line));
    return lines;
}

Result<std::vector<fs::path>> write_learn_report(const LearnReport& report, const fs::path& reference) {
    fs::path base = reference;
    base.replace_extension();
    const fs::path page = base.string() + ".learn.md", table = base.string() + ".learn.csv",
                   picture = base.string() + ".learn.png";
    std::string text = fmt::format("# What was learned: {}\n\n", reference.filename().string());
    for (const std::string& line : describe(report)) text += "- " + line + "\n";
    text += fmt::format(
        "\n![mean, spread and modes]({})\n\nMean, spread (standard deviation between the parts, noise "
        "included) and modes (what changes at one standard deviation of the mode) of the parts at the "
        "reference's pose{}.\n",
        picture.filename().string(),
        report.variation.step > 1
            ? fmt::format(", every {}th lenslet of every {}th row", report.variation.step, report.variation.step)
            : "");
    text += "\n| frame | x, lenslets | y, lenslets | turn, degrees | score by the others |";
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
    if (auto done = common::write_durably(page, text); !done) return tl::unexpected(done.error());
    if (auto done = common::write_durably(table, csv); !done) return tl::unexpected(done.error());
    if (auto done = write_png(picture, pictures_of(report.variation)); !done) return tl::unexpected(done.error());
    return std::vector<fs::path>{page, table, picture};
}

}  // namespace hord::firmware
