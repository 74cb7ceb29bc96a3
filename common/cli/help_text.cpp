#include "common/cli/help_text.h"

#include <algorithm>

#include <sys/ioctl.h>
#include <unistd.h>

namespace hord {
namespace {

constexpr std::string_view kExample = "Example: ";

// Characters of UTF-8 text.
std::size_t width_of(std::string_view text) {
    return static_cast<std::size_t>(
        std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

// Where the description of an option begins: behind the first run of two spaces. 0: there is none.
std::size_t second_column(std::string_view line) {
    const auto first = line.find_first_not_of(' ');
    const auto gap = line.find("  ", first);
    return gap == std::string_view::npos ? 0 : line.find_first_not_of(' ', gap);
}

std::string wrap_line(std::string_view line, std::size_t columns, bool example) {
    if (width_of(line) <= columns) return std::string(line);
    const std::size_t first = std::min(line.find_first_not_of(' '), line.size());
    std::size_t indent = example ? first + 4 : second_column(line);
    if (indent == 0 || indent > columns / 2) indent = std::min(first + (example ? 4U : 2U), columns / 2);
    const std::size_t room = example ? columns - 2 : columns;  // for " \"
    std::string out(line.substr(0, first));
    std::size_t used = first;
    for (std::size_t at = first; at < line.size();) {
        const auto gap = std::min(line.find_first_not_of(' ', at), line.size());
        const auto end = std::min(line.find(' ', gap), line.size());
        const auto word = line.substr(gap, end - gap);
        const std::size_t spaces = gap - at, width = width_of(word);
        if (used > indent && used + spaces + width > room) {
            out += example ? " \\\n" : "\n";
            out.append(indent, ' ');
            used = indent + width;
        } else {
            out.append(spaces, ' ');
            used += spaces + width;
        }
        out += word;
        at = end;
    }
    return out;
}

}  // namespace

int terminal_columns(int fd) {
    winsize size{};
    return ::isatty(fd) == 1 && ::ioctl(fd, TIOCGWINSZ, &size) == 0 ? size.ws_col : 0;
}

std::string wrapped(std::string_view text, int columns) {
    if (columns < 20) return std::string(text);
    std::string out;
    bool example = false;
    for (std::size_t at = 0; at < text.size();) {
        const auto end = std::min(text.find('\n', at), text.size());
        const auto line = text.substr(at, end - at);
        example = line.starts_with(kExample) || (example && line.starts_with(std::string(kExample.size(), ' ')));
        out += wrap_line(line, static_cast<std::size_t>(columns), example);
        if (end < text.size()) out += '\n';
        at = end + 1;
    }
    return out;
}

}  // namespace hord
