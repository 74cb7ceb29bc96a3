#include "lab/report/tables.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;  // NOLINT(readability-redundant-declaration): POSIX wants it declared

namespace hord::lab {
namespace {

namespace fs = std::filesystem;

Result<void> write_text(const fs::path& file, const std::string& text) {
    std::ofstream stream(file);
    stream << text;
    if (!stream.flush())
        return fail(ErrorCode::io, file.string() + " cannot be written",
                    "check that the folder exists, may be written to, and has space");
    return {};
}

// A value with a comma, a quote or a line break is quoted (RFC 4180).
std::string csv_value(const std::string& value) {
    if (value.find_first_of(",\"\n") == std::string::npos) return value;
    std::string quoted = "\"";
    for (const char c : value) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
    return quoted + "\"";
}

template <class Convert>
std::string joined(const std::vector<std::string>& values, const char* between, const Convert& convert) {
    std::string text;
    for (std::size_t k = 0; k < values.size(); ++k) text += (k == 0 ? "" : between) + convert(values[k]);
    return text;
}

std::string as_it_is(const std::string& value) { return value; }

}  // namespace

std::string to_markdown(const Table& table) {
    std::string text = "| " + joined(table.header, " | ", as_it_is) + " |\n|";
    for (std::size_t k = 0; k < table.header.size(); ++k) text += "---|";
    text += '\n';
    for (const auto& row : table.rows) text += "| " + joined(row, " | ", as_it_is) + " |\n";
    return text;
}

std::string to_text(const Table& table) {
    std::vector<std::size_t> widths(table.header.size());
    std::string text;
    const auto each_line = [&](const auto& use) {
        use(table.header);
        for (const auto& row : table.rows) use(row);
    };
    each_line([&](const std::vector<std::string>& line) {
        for (std::size_t k = 0; k < line.size(); ++k) widths[k] = std::max(widths[k], line[k].size());
    });
    each_line([&](const std::vector<std::string>& line) {
        for (std::size_t k = 0; k < line.size(); ++k) text += fmt::format("{:<{}}  ", line[k], widths[k]);
        text.erase(text.find_last_not_of(' ') + 1);
        text += '\n';
    });
    return text;
}

Result<void> write_csv(const fs::path& file, const Table& table) {
    std::string text = joined(table.header, ",", csv_value) + '\n';
    for (const auto& row : table.rows) text += joined(row, ",", csv_value) + '\n';
    return write_text(file, text);
}

Result<std::vector<fs::path>> plot(const fs::path& folder, const std::string& name, const std::string& script,
                                   int width_px, int height_px) {
    const fs::path file = folder / (name + ".gp");
    std::string text = fmt::format("# gnuplot {}.gp draws {}.svg and {}.png\n", name, name, name);
    for (const char* kind : {"svg", "png"}) {
        const bool svg = std::strcmp(kind, "svg") == 0;
        text += fmt::format("reset\nset terminal {} size {},{} background rgb 'white' font '{}'\nset output '{}.{}'\n",
                            svg ? "svg" : "pngcairo", width_px, height_px, "DejaVu Sans,11", name, kind);
        text += script + "\nunset output\n";
    }
    if (auto done = write_text(file, text); !done) return tl::unexpected(done.error());

    std::string program = "gnuplot", argument = file.filename().string();
    char* arguments[] = {program.data(), argument.data(), nullptr};
    posix_spawn_file_actions_t in_folder;
    posix_spawn_file_actions_init(&in_folder);
    posix_spawn_file_actions_addchdir_np(&in_folder, folder.c_str());
    pid_t child = 0;
    const int error = posix_spawnp(&child, "gnuplot", &in_folder, nullptr, arguments, environ);
    posix_spawn_file_actions_destroy(&in_folder);
    if (error != 0) {
        return fail(
            ErrorCode::not_found,
            "gnuplot cannot be started (" + std::string(std::strerror(error)) + "); " + file.string() + " is kept",
            "install gnuplot-nox and run the same command again: what is measured is kept");
    }
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
        return fail(ErrorCode::internal, "gnuplot refused " + file.string(), "see its message above");
    }
    return std::vector<fs::path>{folder / (name + ".svg"), folder / (name + ".png")};
}

}  // namespace hord::lab
