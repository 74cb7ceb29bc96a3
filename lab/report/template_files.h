// The files of docs/results/templates, inside the program: generated at build time by cmake/HordEmbed.cmake.
#pragma once

#include "common/embedded_file.h"

namespace hord::lab {

std::span<const EmbeddedFile> template_files();

}  // namespace hord::lab
