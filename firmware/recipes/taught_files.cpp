#include "firmware/recipes/taught_files.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kEnding = ".hordref";

std::string prefix_of(std::uint16_t number) { return fmt::format("taught-{}-", number); }

// n of "taught-7-n.hordref" and of the files of its report, "taught-7-n.learn.md"; none: another file.
std::optional<std::uint64_t> nth_of(const fs::path& file, std::uint16_t number) {
    const std::string name = file.filename().string(), prefix = prefix_of(number);
    if (!name.starts_with(prefix)) return std::nullopt;
    std::uint64_t n = 0;
    const char* end = name.data() + name.size();
    const auto read = std::from_chars(name.data() + prefix.size(), end, n);
    const std::string_view rest(read.ptr, static_cast<std::size_t>(end - read.ptr));
    if (read.ec != std::errc() || (rest != kEnding && !rest.starts_with(".learn."))) return std::nullopt;
    return n;
}

// Also reports without their reference, and unfinished ones, which a process that was killed may leave.
template <class Do>
void for_each_taught(const fs::path& folder, std::uint16_t number, Do&& what) {
    std::error_code error;
    for (auto entry = fs::directory_iterator(folder, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
        if (const auto n = nth_of(entry->path(), number)) what(entry->path(), *n);
    }
}

}  // namespace

fs::path next_taught_reference(const fs::path& folder, std::uint16_t number) {
    std::uint64_t highest = 0;
    for_each_taught(folder, number, [&](const fs::path&, std::uint64_t n) { highest = std::max(highest, n); });
    return folder / fmt::format("{}{}{}", prefix_of(number), highest + 1, kEnding);
}

void remove_taught_report(const fs::path& reference) {
    std::error_code ignored;
    for (const std::string_view ending : kReportEndings) fs::remove(report_file(reference, ending), ignored);
}

void remove_other_taught(const fs::path& keep, std::uint16_t number) {
    const auto kept = nth_of(keep, number);
    if (!kept) return;
    std::vector<fs::path> old;
    for_each_taught(keep.parent_path(), number, [&](const fs::path& file, std::uint64_t n) {
        if (n != *kept) old.push_back(file);
    });
    std::error_code ignored;
    for (const fs::path& file : old) fs::remove(file, ignored);
}

}  // namespace hord::firmware
