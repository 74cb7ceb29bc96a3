// Names and removal of the files of taught references: <folder>/taught-<recipe>-<n>.hordref and the reports beside
// them.
#pragma once

#include <cstdint>
#include <filesystem>

namespace hord::firmware {

// n is one more than the highest of the recipe number's references and reports in the folder.
std::filesystem::path next_taught_reference(const std::filesystem::path& folder, std::uint16_t number);

// Both ignore errors.
void remove_taught_report(const std::filesystem::path& reference);
// The references and reports of the recipe number but this one's; nothing if `keep` is no taught reference of it.
void remove_other_taught(const std::filesystem::path& keep, std::uint16_t number);

}  // namespace hord::firmware
