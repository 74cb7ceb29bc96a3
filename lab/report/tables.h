// Tables as CSV for programs and Markdown for people, and plots by gnuplot.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/result.h"

namespace hord::lab {

struct Table {
    std::vector<std::string> header;
    std::vector<std::vector<std::string>> rows;  // as many values as the header has
};
std::string to_markdown(const Table& table);
// In columns, for a terminal.
std::string to_text(const Table& table);
// Fails with io.
Result<void> write_csv(const std::filesystem::path& file, const Table& table);

// Writes `script` to NAME.gp in `folder` and lets gnuplot draw NAME.svg and NAME.png there; returns the two pictures.
// The script sets no terminal and no output, and names data files relative to the folder. Fails with not_found when
// there is no gnuplot (the script and the data stay), with internal when gnuplot rejects the script.
Result<std::vector<std::filesystem::path>> plot(const std::filesystem::path& folder, const std::string& name,
                                                const std::string& script, int width_px = 900, int height_px = 540);

}  // namespace hord::lab
