// A file that the build puts into the program (cmake/HordEmbed.cmake).
#pragma once

#include <span>
#include <string_view>

namespace hord {

struct EmbeddedFile {
    std::string_view path, type, text;  // type: for HTTP's Content-Type
};

}  // namespace hord
