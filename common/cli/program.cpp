#include "common/cli/program.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>
#include <vector>

#include <errno.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/cli/help_text.h"
#include "common/cli/message.h"
#include "common/cli/output.h"
#include "common/dangling_link.h"
#include "common/file_kind.h"
#include "common/nearest_name.h"

namespace hord {

Exit complain(const Error& error) {
    print_message("{}\n", named_lines(program_invocation_short_name, error.message()));
    return Exit::bad_input;
}

Result<void> make_folder(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (!error) return {};
    const std::string link = common::dangling_link(folder);
    return fail(ErrorCode::io, folder.string() + " cannot be created (" + (link.empty() ? error.message() : link) + ")",
                "give a folder that may be written to");
}

namespace {

// Device and number of a regular file, after links; none: there is none.
std::optional<std::pair<dev_t, ino_t>> identity_of(const std::string& file) {
    struct stat what {};
    if (file.empty() || ::stat(file.c_str(), &what) != 0 || !S_ISREG(what.st_mode)) return std::nullopt;
    return std::pair(what.st_dev, what.st_ino);
}

}  // namespace

Result<void> check_outputs(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs) {
    for (const auto& [option, file] : outputs) {
        if (file.empty()) continue;
        std::error_code error;
        const std::filesystem::path parent = std::filesystem::path(file).parent_path(),
                                    folder = parent.empty() ? "." : parent;
        if (!std::filesystem::is_directory(folder, error))
            return fail(ErrorCode::not_found, "the folder " + folder.string() + " does not exist", "create it first");
        if (std::filesystem::is_directory(file, error))
            return fail(ErrorCode::invalid_argument, option + " " + file + " is a folder", "give the name of a file");
        int reason = ::access(folder.c_str(), W_OK) == 0 || ::access(file.c_str(), W_OK) == 0 ? 0 : errno;
        if (reason == ENOENT && ::access(folder.c_str(), W_OK) != 0) reason = errno;  // a new file: its folder's reason
        if (reason != 0)
            return fail(ErrorCode::io, option + " " + file + " cannot be written (" + std::strerror(reason) + ")",
                        "give a file in a folder that may be written to");
    }
    return check_overwrites(outputs, inputs);
}

Result<void> check_overwrites(const std::vector<OutputFile>& outputs, const std::vector<std::string>& inputs) {
    std::set<std::pair<dev_t, ino_t>> read, written;
    std::map<std::filesystem::path, std::string> places;
    for (const std::string& input : inputs) {
        if (const auto one = identity_of(input)) read.insert(*one);
    }
    for (const auto& [option, file] : outputs) {
        if (file.empty()) continue;
        const auto one = identity_of(file);
        if (one && read.contains(*one))
            return fail(ErrorCode::refused,
                        option + " " + file + " is one of the files that are read: it is not overwritten",
                        "give another " + option);
        if (auto fine = common::refuse_hand_written(file); !fine)
            return fail(fine.error().code, option + " " + fine.error().what, fine.error().cure);
        std::error_code error;
        if (!one && std::filesystem::exists(file, error)) continue;  // a device
        const auto [place, fresh] = places.emplace(std::filesystem::weakly_canonical(file, error), option);
        if (!fresh || (one && !written.insert(*one).second))
            return fail(ErrorCode::refused, fmt::format("{} {} is written by {}, too", option, file, place->second),
                        "give each a file of its own");
    }
    return {};
}

Result<void> check_extension(const OutputFile& output, const std::vector<std::string>& extensions) {
    std::string extension = std::filesystem::path(output.file).extension().string();
    std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
    if (extension.empty() || std::ranges::find(extensions, extension) != extensions.end()) return {};
    const std::string known = CLI::detail::join(extensions, " or ");
    return fail(ErrorCode::invalid_argument,
                fmt::format("{} {} does not end in {}, which is what is written", output.option, output.file, known),
                "give it a name that ends in " + known);
}

CLI::Validator positive() {
    return CLI::Validator(
        [](const std::string& text) {
            double number = 0;
            if (!CLI::detail::lexical_cast(text, number)) return "\"" + text + "\" is no number";
            return number > 0 ? std::string() : text + " is not above 0";
        },
        "POSITIVE");
}

namespace {

// A descriptor from 0 to 2 that is closed gets /dev/null. Otherwise the next socket or file would get its number, and
// messages would be written there. Output still fails, as on a closed descriptor: that descriptor cannot be written.
void open_standard_streams() {
    for (const auto& [descriptor, access] :
         {std::pair(STDIN_FILENO, O_RDONLY), {STDOUT_FILENO, O_RDONLY}, {STDERR_FILENO, O_WRONLY}}) {
        if (::fcntl(descriptor, F_GETFD) < 0) (void)::open("/dev/null", access);  // the lowest that is free
    }
}

// Why `text` is no number of `type` (INT..., UINT..., FLOAT...). Empty: it is one. CLI11 reads 010 as octal, and -3 as
// 18446744073709551613.
std::string number_problem(const std::string& text, bool whole, bool natural) {
    double number = 0;
    if (!CLI::detail::lexical_cast(text, number)) return "\"" + text + "\" is no number";
    if (!std::isfinite(number)) return text + " is no finite number";
    if (!whole) return {};
    const auto digits = text.find_first_not_of("+-");
    const bool decimal =
        digits != std::string::npos && text.find_first_not_of("0123456789", digits) == std::string::npos;
    std::int64_t sign = 0;
    std::uint64_t magnitude = 0;
    if (!CLI::detail::lexical_cast(text, sign) && !CLI::detail::lexical_cast(text, magnitude))
        return "\"" + text + "\" is no whole number";
    if (natural && text.starts_with('-')) return text + " is below 0";
    if (decimal) {  // CLI11 takes a larger one for the largest
        const std::string_view most = natural ? "18446744073709551615" : "9223372036854775807",
                               number_text = std::string_view(text).substr(digits);
        if (number_text.size() > most.size() || (number_text.size() == most.size() && number_text > most))
            return text + " is out of range";
    }
    if (decimal && text[digits] == '0' && digits + 1 < text.size()) return text + " begins with 0: write it without";
    return {};
}

// Of an argument that is "": a script's variable that is not set would otherwise read as an option that is not given.
constexpr const char* kEmpty = "is empty: is a variable of the script not set?";

// "--recipe=" has no value: CLI11 would take the next argument for it.
void refuse_empty_assignments(const CLI::App& program, int argc, char** argv) {
    const CLI::App* command = &program;
    for (int k = 1; k < argc; ++k) {
        std::string word = argv[k];
        if (word == "--") return;
        for (const CLI::App* next : command->get_subcommands({})) {
            if (next->check_name(word)) {
                command = next;
                break;
            }
        }
        if (!word.starts_with("--") || !word.ends_with('=')) continue;
        word.pop_back();
        if (command->get_option_no_throw(word) != nullptr) throw CLI::ValidationError(word, kEmpty);
    }
}

void refuse_empty_and_odd_values(CLI::App& program) {
    for (CLI::Option* option : program.get_options()) {
        if (option->get_items_expected_max() > 0)
            option->check(CLI::Validator([](const std::string& text) { return text.empty() ? kEmpty : ""; }, ""));
        const std::string type = option->get_type_name();
        const bool natural = type.starts_with("UINT"), whole = natural || type.starts_with("INT");
        if (!whole && !type.starts_with("FLOAT")) continue;
        option->check(
            CLI::Validator([=](const std::string& text) { return number_problem(text, whole, natural); }, ""));
    }
    for (CLI::App* command : program.get_subcommands({})) refuse_empty_and_odd_values(*command);
}

// The command that the user meant, as far as it was given rightly, and its name.
std::pair<const CLI::App*, std::string> deepest_command(const CLI::App& program) {
    const CLI::App* command = &program;
    std::string name = program_invocation_short_name;
    while (!command->get_subcommands().empty()) {
        command = command->get_subcommands().front();
        name += " " + command->get_name();
    }
    return {command, name};
}

bool has_option(const CLI::App& command, const std::string& option) {
    return command.get_option_no_throw(option) != nullptr ||
        std::ranges::any_of(command.get_subcommands({}), [&](const CLI::App* one) { return has_option(*one, option); });
}

// "X is not known", with the option or command that is most like it.
std::string unknown_text(const CLI::App& command, std::string word) {
    word.resize(std::min(word.find('='), word.size()));
    const bool option = word.starts_with('-');
    if (option && has_option(command, word))
        return "\"" + word + "\" stands before the command that it belongs to: write it behind";
    std::vector<std::string> names;
    if (option) {
        for (const CLI::Option* one : command.get_options()) {
            for (const std::string& name : one->get_lnames()) names.push_back("--" + name);
        }
    } else {
        for (const CLI::App* one : command.get_subcommands({})) names.push_back(one->get_name());
    }
    auto meant = word.size() > 2 ? common::nearest_name(word, names) : std::nullopt;
    if (!option && command.get_option_no_throw("--" + word) != nullptr) meant = "--" + word;  // help, version
    const bool misplaced = !option && names.empty();
    return "\"" + word + (misplaced ? "\" is one argument too many" : "\" is not known") +
        (meant ? ": did you mean " + *meant + "?" : "");
}

// "NAME: WORD not in {a,b,c}", as CLI11 says it: with the name that is most like it.
std::string not_in_text(const std::string& text) {
    constexpr std::string_view kNotIn = " not in {";
    const auto at = text.find(kNotIn), name = text.find(": ");
    if (at == std::string::npos || name == std::string::npos || name + 2 > at || !text.ends_with('}')) return text;
    const std::string word = text.substr(name + 2, at - name - 2);
    const auto names = CLI::detail::split(text.substr(at + kNotIn.size(), text.size() - at - kNotIn.size() - 1), ',');
    std::vector<std::string> meant;
    if (const auto nearest = common::nearest_name(word, names)) meant.push_back(*nearest);
    else if (word.size() > 2)
        std::ranges::copy_if(names, std::back_inserter(meant), [&](const auto& one) { return one.starts_with(word); });
    return fmt::format("{}: \"{}\" is none of {}{}", text.substr(0, name), word, CLI::detail::join(names, ", "),
                       meant.empty() ? "" : ": did you mean " + CLI::detail::join(meant, " or ") + "?");
}

// "Could not convert: NAME = VALUE", as CLI11 says of a value behind the "=" of a flag, and of a number that its type
// does not hold; others were refused before.
std::string not_converted_text(const CLI::App& command, const std::string& text) {
    constexpr std::string_view kCould = "Could not convert: ";
    const auto is = text.find(" = ");
    if (!text.starts_with(kCould) || is == std::string::npos) return text;
    const std::string name = text.substr(kCould.size(), is - kCould.size()), value = text.substr(is + 3);
    const CLI::Option* option = command.get_option_no_throw(name);
    if (option != nullptr && option->get_items_expected_max() == 0)
        return name + " takes no value: leave \"=" + value + "\" out";
    return name + ": " + value + " is out of range";
}

// What an option takes, from what CLI11 calls its type: "INT:POSITIVE", "TEXT:{md,csv}".
std::string value_text(const std::string& type) {
    const auto open = type.find('{');
    if (open != std::string::npos && type.ends_with('}')) {
        const auto names = CLI::detail::split(type.substr(open + 1, type.size() - open - 2), ',');
        return "a value: one of " + CLI::detail::join(names, ", ");
    }
    return type.starts_with("INT") || type.starts_with("UINT") || type.starts_with("FLOAT") ? "a number" : "a value";
}

// Of an option without its value, or with too many. CLI11 says "NAME: 1 required TEXT missing" and "NAME: At Most 1
// required but received 2".
std::string mismatch_text(const CLI::App& command, const std::string& text) {
    const std::string name = text.substr(0, text.find(": "));
    const CLI::Option* option = command.get_option_no_throw(name);
    if (option == nullptr) return text;
    if (text.ends_with(" missing")) return name + " needs " + value_text(option->get_type_name());
    if (text.find(": At Most 1 ") == std::string::npos) return text;
    return fmt::format("{} is given {} times: give it once", name, text.substr(text.rfind(' ') + 1));
}

// "NAME excludes OTHER", "NAME requires OTHER".
std::string together_text(std::string text) {
    for (const auto& [theirs, ours] : {std::pair(" excludes ", " cannot be given together with "),
                                       std::pair(" requires ", " has no effect without ")}) {
        if (const auto at = text.find(theirs); at != std::string::npos)
            text.replace(at, std::string_view(theirs).size(), ours);
    }
    return text;
}

std::string mistake_text(const CLI::App& program, const CLI::App& command, const CLI::ParseError& error) {
    const auto unknown = program.remaining(true);
    const bool required = dynamic_cast<const CLI::RequiredError*>(&error) != nullptr;
    const bool extra = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr;
    if ((required || extra) && !unknown.empty()) return unknown_text(command, unknown.front());
    if (required && !command.get_subcommands({}).empty()) return "no command is given";
    const std::string text = error.what();
    if (const auto at = text.find(std::string(": ") + kEmpty); at != std::string::npos)
        return text.substr(0, at) + " " + kEmpty;
    if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) return mismatch_text(command, text);
    if (dynamic_cast<const CLI::ExcludesError*>(&error) != nullptr ||
        dynamic_cast<const CLI::RequiresError*>(&error) != nullptr)
        return together_text(text);
    return not_converted_text(command, not_in_text(text));
}

}  // namespace

std::optional<int> parse_command_line(CLI::App& program, int argc, char** argv) {
    open_standard_streams();
    const char* name = program_invocation_short_name;
    refuse_empty_and_odd_values(program);
    try {
        refuse_empty_assignments(program, argc, argv);
        program.parse(argc, argv);
    } catch (const CLI::Success& asked) {  // --help, --version
        std::ostringstream text;
        const int status = program.exit(asked, text, text);
        print_output(wrapped(text.str(), terminal_columns(STDOUT_FILENO)));
        return end_output(status);
    } catch (const CLI::ParseError& error) {
        const auto [command, command_name] = deepest_command(program);
        const std::string what = mistake_text(program, *command, error);
        print_message("{}: {}{} {} --help\n", name, what, what.ends_with('?') ? " See" : ": see", command_name);
        return static_cast<int>(Exit::bad_input);
    } catch (const std::exception& error) {
        if (std::ferror(stdout) != 0) {
            if (const auto* why = dynamic_cast<const std::system_error*>(&error)) note_lost_output(why->code().value());
            return end_output(0);
        }
        print_message("{}: stopped by an unexpected error: {}: please report it\n", name, error.what());
        return static_cast<int>(Exit::bad_input);
    }
    return std::nullopt;
}

int run_command_line(CLI::App& program, int argc, char** argv, const Exit& status) {
    const auto ended = parse_command_line(program, argc, argv);
    return end_output(ended ? *ended : static_cast<int>(status));
}

}  // namespace hord
