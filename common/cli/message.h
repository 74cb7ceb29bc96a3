// What a program says on stderr.
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace hord {

// "NAME: text", on each of its lines: a log that is searched for the name, or cut into lines, keeps all of them.
inline std::string named_lines(std::string_view name, std::string_view text) {
    std::string out;
    for (std::size_t at = 0; at <= text.size();) {
        const std::size_t end = std::min(text.find('\n', at), text.size());
        out += fmt::format("{}{}: {}", at == 0 ? "" : "\n", name, text.substr(at, end - at));
        at = end + 1;
    }
    return out;
}

// For programs that must go on: from now on a message that stderr does not take at once (a full pipe, a terminal that
// is held) is lost. The next that it takes says how many were.
void never_wait_for_stderr();

// Any thread. Prints on stderr. What cannot be written there (a full disk, a closed terminal) is lost: no program ends
// for it. Returns whether all of it was written.
bool write_message(std::string_view text);

template <class... Parts>
void print_message(fmt::format_string<Parts...> format, Parts&&... parts) {
    write_message(fmt::format(format, std::forward<Parts>(parts)...));
}

}  // namespace hord
