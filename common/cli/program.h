// Shared by the command-line programs: exit statuses, error output, and running a command line.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "common/result.h"

namespace hord {

// Exit statuses of every command (`hordctl --help`).
enum class Exit : int {
    good = 0,       // done; all parts pass
    rejected = 1,   // done; at least one part rejected
    bad_input = 2,  // usage or unreadable input: one clear line on stderr
    unfit = 3,      // done; at least one frame could not be judged, none rejected
};

// Prints `error` after the program's name as one line (more, when there are several problems) on stderr. Returns
// bad_input.
Exit complain(const Error& error);

// Creates the folder of an option such as --out if it does not exist. Fails with io.
Result<void> make_folder(const std::filesystem::path& folder);

// A file that the command will write: the option that names it (shown in errors), and its path ("": none).
struct OutputFile {
    std::string option, file;
};

// check_overwrites(); also fails with not_found (the output's folder), invalid_argument (the output is a folder) and io
// (this user may not write there): for commands that work long before they write.
Result<void> check_outputs(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs);

// Fails with refused if an output is one of the files that the command reads (also by another name or a link), if it is
// there already and holds what people write (file_kind.h), or if two outputs are one file. Devices and pipes are no
// such files. Inputs that are "" or do not exist are ignored.
Result<void> check_overwrites(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs);

// Fails with invalid_argument if the output's extension is none of `extensions` (".png"). None at all is allowed.
Result<void> check_extension(const OutputFile& output, const std::vector<std::string>& extensions);

// As CLI::Range, for numbers that people type: "abc" is told to be no number.
template <class Limit>
CLI::Validator in_range(Limit low, Limit high) {
    const auto digits = [](Limit limit) {
        std::string text = std::to_string(limit);  // of a floating-point number: with six decimals
        if (text.find('.') == std::string::npos) return text;
        text.erase(text.find_last_not_of('0') + 1);
        if (text.back() == '.') text.pop_back();
        return text;
    };
    CLI::Validator range = CLI::Range(low, high);
    range.operation([low, high, limits = digits(low) + " to " + digits(high)](const std::string& text) {
        double number = 0;
        if (!CLI::detail::lexical_cast(text, number)) return "\"" + text + "\" is no number: give " + limits;
        const bool inside = number >= static_cast<double>(low) && number <= static_cast<double>(high);
        return inside ? std::string() : text + " is not in the range " + limits;
    });
    return range;
}

// An option for a number in [low, high], whose default --help shows.
template <class Number, class Limit>
CLI::Option* add_number(CLI::App& command, const std::string& name, Number& value, const std::string& help, Limit low,
                        Limit high) {
    return command.add_option(name, value, help)->check(in_range(low, high))->capture_default_str();
}

// Any number above 0, in place of CLI::PositiveNumber: that one prints its limits with 300 digits.
CLI::Validator positive();

// Parses the command line, which runs the command's callback. Returns the exit status if the program ends here: after
// --help and --version, and with one line on stderr for wrong usage and unexpected exceptions (bad_input).
std::optional<int> parse_command_line(CLI::App& program, int argc, char** argv);

// The same for programs whose callbacks do the work: returns the exit status for main(), `status` as they left it.
int run_command_line(CLI::App& program, int argc, char** argv, const Exit& status);

}  // namespace hord
