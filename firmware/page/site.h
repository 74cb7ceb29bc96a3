// The files of firmware/page/site, inside the program: generated at build time by cmake/HordEmbed.cmake.
#pragma once

#include "common/embedded_file.h"

namespace hord::firmware::page {

std::span<const EmbeddedFile> site_files();

}  // namespace hord::firmware::page
