// Text for a terminal: wrapping of help and pages, and the name that a mistyped one may mean.
#pragma once

#include <string>
#include <string_view>

namespace hord {

// Columns of the terminal behind `fd`; 0: it is none, or does not say.
int terminal_columns(int fd);

// `text` with lines of at most `columns` characters, broken at spaces. A line goes on below its second column (of
// options: the description), else below its first word. An example's line ends in " \" where it is broken, so that it
// can still be pasted. A word that is longer stays whole. 0 columns: unchanged.
std::string wrapped(std::string_view text, int columns);

}  // namespace hord
