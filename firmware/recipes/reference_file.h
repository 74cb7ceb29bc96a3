// A Reference (algo/reference/reference.h) as a file: the magic "HORDREF", a version, the numbers little-endian, and at
// the end a CRC-32 of all that comes before it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>

#include "algo/reference/reference.h"
#include "common/result.h"

namespace hord::firmware {

constexpr std::uint32_t kReferenceVersion = 1;

// Whole or not at all. Fails with io.
Result<void> write_reference(const std::filesystem::path& file, const algo::Reference& reference);

// Fails with not_found, unreadable (not such a file, cut off, its checksum is wrong), unsupported (another version).
Result<std::shared_ptr<const algo::Reference>> read_reference(const std::filesystem::path& file);

// CRC-32 of all that it says, as a file of it has at its end; any thread. A reference at paper size is some 90 MB: the
// sum is made once, and remembered as long as the reference lives. What is read from a file has it already.
std::uint32_t crc32_of(const std::shared_ptr<const algo::Reference>& reference);

}  // namespace hord::firmware
