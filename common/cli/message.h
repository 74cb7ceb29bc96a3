// What a program says on stderr.
#pragma once

#include <cstdio>
#include <utility>

#include <fmt/format.h>

namespace hord {

// Prints on stderr. What cannot be written there (a full disk, a closed terminal) is lost: no program ends for it.
// fmt::print() would throw.
template <class... Parts>
void print_message(fmt::format_string<Parts...> format, Parts&&... parts) {
    std::fputs(fmt::format(format, std::forward<Parts>(parts)...).c_str(), stderr);
}

}  // namespace hord
