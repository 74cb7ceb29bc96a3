#include "common/cli/program.h"

#include <cstdio>
#include <cstring>

#include <errno.h>
#include <fmt/format.h>

namespace hord {

Exit complain(const Error& error) {
    fmt::print(stderr, "{}: {}\n", program_invocation_short_name, error.message());
    return Exit::bad_input;
}

Result<void> make_folder(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (!error) return {};
    return fail(ErrorCode::io, folder.string() + " cannot be created (" + error.message() + ")",
                "give a folder that may be written to");
}

CLI::Validator positive() {
    return CLI::Validator(
        [](const std::string& text) {
            double number = 0;
            const bool fine = CLI::detail::lexical_cast(text, number) && number > 0;
            return fine ? std::string() : text + " is not above 0";
        },
        "POSITIVE");
}

int end_output(int status) {
    const bool lost = std::ferror(stdout) != 0;
    if (std::fflush(stdout) == 0 && !lost) return status;
    const std::string why = lost ? "" : std::string(" (") + std::strerror(errno) + ")";
    return static_cast<int>(
        complain({ErrorCode::io, "the output could not be written" + why, "see that its disk has space"}));
}

namespace {

// CLI11 reads 010 as octal.
void refuse_leading_zeros(CLI::App& program) {
    for (CLI::Option* option : program.get_options()) {
        const std::string type = option->get_type_name();
        if (!type.starts_with("INT") && !type.starts_with("UINT")) continue;
        option->check(CLI::Validator(
            [](const std::string& text) {
                const auto digits = text.find_first_of("0123456789");
                const bool octal = digits != std::string::npos && text[digits] == '0' && digits + 1 < text.size() &&
                    text.find_first_not_of("0123456789", digits) == std::string::npos;
                return octal ? text + " begins with 0: write it without" : std::string();
            },
            ""));
    }
    for (CLI::App* command : program.get_subcommands({})) refuse_leading_zeros(*command);
}

}  // namespace

std::optional<int> parse_command_line(CLI::App& program, int argc, char** argv) {
    const char* name = program_invocation_short_name;
    refuse_leading_zeros(program);
    try {
        program.parse(argc, argv);
    } catch (const CLI::Success& asked) {  // --help, --version
        return end_output(program.exit(asked));
    } catch (const CLI::ParseError& error) {
        std::string what = error.what();
        if (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr) {
            if (const auto unknown = program.remaining(true); !unknown.empty())
                what = "\"" + unknown.front() + "\" is not known";
        }
        fmt::print(stderr, "{}: {}: see {} --help\n", name, what, name);
        return static_cast<int>(Exit::bad_input);
    } catch (const std::exception& error) {
        if (std::ferror(stdout) != 0) return end_output(0);
        fmt::print(stderr, "{}: stopped by an unexpected error: {}: please report it\n", name, error.what());
        return static_cast<int>(Exit::bad_input);
    }
    return std::nullopt;
}

int run_command_line(CLI::App& program, int argc, char** argv, const Exit& status) {
    const auto ended = parse_command_line(program, argc, argv);
    return end_output(ended ? *ended : static_cast<int>(status));
}

}  // namespace hord
