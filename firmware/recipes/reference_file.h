// A Reference (algo/reference/reference.h) as a file: the magic "HORDREF", a version, the values in little-endian
// order, and a CRC-32 of everything before it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>

#include "algo/reference/reference.h"
#include "common/result.h"

namespace hord::firmware {

// Version 1 has no pooled_scales, versions 1 and 2 have no size_limits, versions 1 to 3 no blur_limits and no
// patch_limit; they are read, too.
constexpr std::uint32_t kReferenceVersion = 4, kOldestReferenceVersion = 1;

// Replaces the file durably (common/file_writing.h). Fails with io.
Result<void> write_reference(const std::filesystem::path& file, const algo::Reference& reference);

// Fails with not_found, unreadable (another kind of file, truncated, wrong checksum), unsupported (another version).
Result<std::shared_ptr<const algo::Reference>> read_reference(const std::filesystem::path& file);

// What the file says of itself at its beginning and its end: the maps are neither read nor checked.
struct ReferenceFacts {
    algo::Extents extents;
    std::uint32_t parts = 0;
    std::uint32_t crc32 = 0;  // crc32_of(), if the file is whole
};
// Fails as read_reference(), and with unreadable if it is no regular file.
Result<ReferenceFacts> read_reference_facts(const std::filesystem::path& file);

// The files of a report lie beside the reference (docs/commands.md): its name, with this ending instead of its own. The
// JSON is written last.
inline constexpr std::string_view kReportEndings[] = {".learn.png", ".learn.csv", ".learn.md", ".learn.json"};
std::filesystem::path report_file(const std::filesystem::path& reference, std::string_view ending);

// Size of the file without its head, which is small.
std::size_t bytes_of_maps(const algo::Extents& extents);

// The CRC-32 that the reference's file has. Any thread. A reference of paper size has some 90 MB, so the value is
// computed once and cached while the reference exists; read_reference() caches the file's.
std::uint32_t crc32_of(const std::shared_ptr<const algo::Reference>& reference);

}  // namespace hord::firmware
