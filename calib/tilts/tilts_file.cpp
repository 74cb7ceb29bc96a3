// tilts.toml: the frames and their directions.
#include <numbers>

#include <fmt/format.h>

#include "calib/tilts/tilts.h"
#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/toml_fields.h"

namespace hord::calib {
namespace {

constexpr double kLargest = 0.5;  // rad: beyond it the small-angle approximation is not valid

// One angle, in radians or degrees; exactly one of them.
void angle(common::TomlTable& table, std::string_view axis, double& value) {
    const std::string rad = fmt::format("{}_rad", axis);
    const std::string deg = fmt::format("{}_deg", axis);
    if (table.has(rad) == table.has(deg)) {
        table.problem(rad, fmt::format("give {} or {}, one of them", rad, deg), "write the angle of this capture");
        return;
    }
    table.number(rad, value, -kLargest, kLargest);
    double degrees = 0;
    table.number(deg, degrees, -kLargest * 180 / std::numbers::pi, kLargest * 180 / std::numbers::pi);
    if (table.has(deg)) value = degrees * std::numbers::pi / 180;
}

}  // namespace

Result<TiltList> parse_tilts(std::string_view text, std::string_view name) {
    if (auto right = common::require_kind(text, name, common::FileKind::tilts); !right)
        return tl::unexpected(right.error());
    common::TomlProblems problems;
    auto root = common::TomlTable::parse_text(text, name, problems);
    TiltList list;
    root.text("empty", list.empty);
    root.text("dark", list.dark);
    root.text("flat", list.flat);
    if (list.empty.empty() && problems.empty()) {
        root.problem("empty", "the empty field's collimated frame is missing",
                     "capture collimated light without a part and without a tilt: it defines zero");
    }
    for (auto& table : root.tables("tilt")) {
        TiltEntry entry;
        table.text("frame", entry.frame);
        if (entry.frame.empty()) table.problem("frame", "a tilt without a frame", "name the file");
        angle(table, "x", entry.direction.x_rad);
        angle(table, "y", entry.direction.y_rad);
        list.tilts.push_back(std::move(entry));
    }
    root.refuse_unknown_keys();
    if (!problems.empty()) return problems.as_error();
    return list;
}

Result<TiltList> read_tilts(const std::filesystem::path& file) {
    const auto text = common::read_file(file, common::kMaxText);
    if (!text) {
        return fail(ErrorCode::unreadable, fmt::format("{}: cannot be read", file.string()),
                    "list the captures in tilts.toml, beside the frames");
    }
    return parse_tilts(*text, file.string());
}

}  // namespace hord::calib
