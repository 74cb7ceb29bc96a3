#include "common/cli/program.h"

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
