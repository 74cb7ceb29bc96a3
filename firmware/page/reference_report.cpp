#include "firmware/page/reference_report.h"

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string_view>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/crc32.h"
#include "common/toml_fields.h"
#include "common/unique_fd.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware::page {
namespace {

namespace fs = std::filesystem;
using store::Json;

constexpr std::int64_t kSchema = 1;
constexpr std::size_t kMaxReport = 1 << 20, kMaxPicture = 16 << 20;  // bytes of the files
constexpr std::size_t kMaxRows = 200, kMaxText = 1000;               // of what is passed on

constexpr const char* kNone =
    "The station judges without a reference: it compares each lenslet with its neighbours. Against a reference of good "
    "parts it finds more. Teach it one: hordctl teach --parts 24.";
constexpr const char* kRelative =
    "The recipe names this file by a path that depends on where the station was started, so this page cannot find it.";
constexpr const char* kNoReport =
    "There is no report of this reference. A teach writes one within minutes; if the station ended or a new teach "
    "began before, there will be none, and the frames are gone. The reference judges as well without it. To have one, "
    "teach again, or learn from frames of good parts (hordctl learn, not with --no-check).";
constexpr const char* kOther = "The report beside this reference is of another one. Learn again to have its own.";
constexpr const char* kDamaged = "The report of this reference is damaged. Learn again, or delete the report.";

// Empty: the recipe has none.
fs::path file_of(const Json& recipe) {
    const auto text = store::text_in(recipe, "text");
    std::string file;
    common::TomlProblems problems;
    if (text) common::TomlTable::parse_text(*text, "recipe", problems).table("reference").text("file", file);
    return file;
}

// A regular file whole, never through a symbolic link. Fails with not_found, unreadable.
Result<std::string> read_small(const fs::path& file, std::size_t most) {
    const common::UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW | O_NOCTTY));
    if (!fd && errno == ENOENT) return fail(ErrorCode::not_found, "there is no such file", "learn the reference again");
    struct stat what {};
    std::string text;
    const bool fits =
        fd && ::fstat(fd.get(), &what) == 0 && S_ISREG(what.st_mode) && std::cmp_less_equal(what.st_size, most);
    if (fits) text.resize(static_cast<std::size_t>(what.st_size));
    if (!fits || ::pread(fd.get(), text.data(), text.size(), 0) != static_cast<ssize_t>(text.size()))
        return fail(ErrorCode::unreadable, "a file of the report cannot be read",
                    "check the rights of the page's user, and learn the reference again");
    return text;
}

// The report beside the reference as its file has it. Fails with not_found, unreadable; refused: of another reference.
Result<Json> read_report(const fs::path& reference, std::uint32_t crc32) {
    const auto text = read_small(report_file(reference, ".learn.json"), kMaxReport);
    if (!text) return tl::unexpected(text.error());
    Json report = store::parse_stored(*text);
    const auto of = store::text_in(report, "reference_crc32");
    if (store::integer_in(report, "schema") != kSchema || !of)
        return fail(ErrorCode::unreadable, "the report is damaged", "learn the reference again");
    if (*of != fmt::format("{:08X}", crc32))
        return fail(ErrorCode::refused, "the report is of another reference", "learn the reference again");
    return report;
}

Json shortened(const std::string& text) {
    std::size_t end = std::min(text.size(), kMaxText);
    while (end < text.size() && end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
    return text.substr(0, end);
}

// Of `row`, those members that are texts, numbers, or null where a number may be missing.
Json picked(const Json& row, std::initializer_list<const char*> texts, std::initializer_list<const char*> numbers) {
    Json picked = Json::object();
    for (const char* name : texts) picked[name] = shortened(store::text_in(row, name).value_or(""));
    for (const char* name : numbers) {
        const bool is = row.is_object() && row.contains(name) && row[name].is_number();
        picked[name] = is ? row[name] : Json();
    }
    return picked;
}
Json picked_rows(const Json& report, const char* list, std::initializer_list<const char*> texts,
                 std::initializer_list<const char*> numbers) {
    Json rows = Json::array();
    if (!report.contains(list) || !report[list].is_array()) return rows;
    for (const Json& row : report[list]) {
        if (rows.size() == kMaxRows) break;
        rows.push_back(picked(row, texts, numbers));
    }
    return rows;
}

}  // namespace

Json reference_json(const Json& recipe) {
    Json shown{{"file", nullptr}, {"since", store::text_in(recipe, "time").value_or("")}, {"report", nullptr}};
    const fs::path file = file_of(recipe);
    const auto because = [&](const char* note) {
        shown["note"] = note;
        return shown;
    };
    if (file.empty()) return because(kNone);
    shown["file"] = shortened(file.filename().string());
    if (file.is_relative()) return because(kRelative);
    const auto facts = read_reference_facts(file);
    if (!facts) {
        return because(facts.error().code == ErrorCode::not_found
                           ? "This page does not find the reference's file, and so no report beside it."
                           : "This page cannot read the reference's file: it may not, or the file is damaged.");
    }
    shown["parts"] = facts->parts;
    const auto report = read_report(file, facts->crc32);
    if (!report) {
        return because(report.error().code == ErrorCode::not_found     ? kNoReport
                           : report.error().code == ErrorCode::refused ? kOther
                                                                       : kDamaged);
    }
    Json& of = shown["report"] = picked(*report, {"learned"}, {"parts_given"});
    of["sentences"] = picked_rows(*report, "sentences", {"about", "text"}, {});
    of["left_out"] = picked_rows(*report, "left_out", {"frame", "why"}, {});
    of["flaws"] = picked_rows(*report, "flaws", {"kind", "size", "unit"}, {"a90", "a90_95", "trials", "found"});
    of["false_rejects"] = report->contains("false_rejects")
        ? picked((*report)["false_rejects"], {}, {"parts", "rejected", "bound", "tail_bound"})
        : Json();
    of["picture"] = report->contains("picture") ? picked((*report)["picture"], {"crc32"}, {"width", "height"}) : Json();
    return shown;
}

Result<std::string> reference_picture(const Json& recipe, std::uint32_t crc32) {
    const fs::path file = file_of(recipe);
    const auto facts =
        file.is_absolute() ? read_reference_facts(file) : Result<ReferenceFacts>(fail(ErrorCode::not_found, "", ""));
    const auto report = facts ? read_report(file, facts->crc32) : Result<Json>(tl::unexpected(facts.error()));
    const bool known = report && report->contains("picture") &&
        store::text_in((*report)["picture"], "crc32") == fmt::format("{:08X}", crc32);
    if (!known) {
        return fail(ErrorCode::not_found, "the reference in use has no such picture",
                    "ask /api/reference for the picture's checksum");
    }
    auto picture = read_small(report_file(file, ".learn.png"), kMaxPicture);
    if (picture && common::crc32(*picture) != crc32)
        return fail(ErrorCode::unreadable, "the picture is damaged", "learn the reference again");
    return picture;
}

}  // namespace hord::firmware::page
