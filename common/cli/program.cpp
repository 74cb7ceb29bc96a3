#include "common/cli/program.h"

#include <errno.h>
#include <fmt/format.h>

namespace hord {

Exit complain(const Error& error) {
    fmt::print(stderr, "{}: {}\n", program_invocation_short_name, error.message());
    return Exit::bad_input;
}

std::optional<int> parse_command_line(CLI::App& program, int argc, char** argv) {
    const char* name = program_invocation_short_name;
    try {
        program.parse(argc, argv);
    } catch (const CLI::Success& asked) {  // --help, --version
        return program.exit(asked);
    } catch (const CLI::ParseError& error) {
        fmt::print(stderr, "{}: {}: see {} --help\n", name, error.what(), name);
        return static_cast<int>(Exit::bad_input);
    } catch (const std::exception& error) {
        fmt::print(stderr, "{}: stopped by an unexpected error: {}: please report it\n", name, error.what());
        return static_cast<int>(Exit::bad_input);
    }
    return std::nullopt;
}

int run_command_line(CLI::App& program, int argc, char** argv, const Exit& status) {
    const auto ended = parse_command_line(program, argc, argv);
    return ended ? *ended : static_cast<int>(status);
}

}  // namespace hord
