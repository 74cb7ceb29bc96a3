// The files of firmware/page/site, inside the program: generated at build time by firmware/page/embed.cmake.
#pragma once

#include <span>
#include <string_view>

namespace hord::firmware::page {

struct SiteFile {
    std::string_view path, type, text;
};
std::span<const SiteFile> site_files();

}  // namespace hord::firmware::page
