// hordctl recipe: the recipes of a folder, whether they can be used, their seals; and which one a station uses.
#include <algorithm>
#include <iterator>
#include <regex>

#include <fmt/format.h>
#include <sys/stat.h>

#include "common/cli/message.h"
#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/toml_fields.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/station/remote.h"
#include "firmware/recipes/recipe_folder.h"

namespace hord::firmware {
namespace {

struct RecipeOptions {
    std::string folder = "/etc/hord/recipes";
    std::vector<std::string> files;
    std::uint16_t number = 0;
    std::string crc32;
    RemoteOptions remote;
};

Exit list(const RecipeOptions& options) {
    const auto all = list_recipes(options.folder);
    if (!all) return complain({all.error().code, all.error().what, "give the folder that the recipes are in"});
    fmt::print("{:>6} {:>8} {:<10} {:<24} {}\n", "number", "version", "crc32", "name", "file");
    Exit status = Exit::good;
    for (const RecipeEntry& one : *all) {
        if (!one.recipe) {
            status = complain(one.recipe.error());
            continue;
        }
        const NumberedRecipe& r = *one.recipe;
        fmt::print("{:>6} {:>8} {:<10} {:<24} {}\n", r.number, r.version, fmt::format("{:08X}", crc32_of(r)),
                   r.recipe.name, one.file.filename().string());
    }
    if (const auto unique = check_numbers(*all); !unique) status = complain(unique.error());
    return status;
}

Exit check(const RecipeOptions& options) {
    Exit status = Exit::good;
    std::vector<RecipeEntry> all;
    for (const std::string& file : options.files) {
        const auto recipe = load_numbered_recipe(file);
        all.push_back({file, recipe});
        if (!recipe) {
            status = complain(recipe.error());
            continue;
        }
        fmt::print("{}: number {}, version {}, CRC-32 {:08X}\n", file, recipe->number, recipe->version,
                   crc32_of(*recipe));
        for (const std::string& note : notes(*recipe)) fmt::print("{}: note: {}\n", file, note);
    }
    if (const auto unique = check_numbers(all); !unique) status = complain(unique.error());
    return status;
}

// "owner 0 and group 0": what of a file's access has changed; "" if nothing has.
std::string lost_access(const struct stat& before, const struct stat& after) {
    std::string text;
    if (before.st_uid != after.st_uid) text = fmt::format("owner {}", before.st_uid);
    if (before.st_gid != after.st_gid) text += fmt::format("{}group {}", text.empty() ? "" : " and ", before.st_gid);
    return text;
}

// Writes the crc32 key, in its place when there is one, else as the first line; everything else stays as it is.
Exit seal(const RecipeOptions& options) {
    for (const std::string& file : options.files) {
        const auto read = common::read_file(file);
        if (!read) return complain(common::cannot_read(file));
        if (auto fine = common::refuse_blank(*read, file); !fine) return complain(fine.error());
        if (auto right = common::require_kind(*read, file, common::FileKind::recipe); !right)
            return complain(right.error());
        static const std::regex old_seal("(^|\n)crc32[ \t]*=[^\n]*\n");
        const std::string text = std::regex_replace(*read, old_seal, "$1");
        const auto recipe = parse_recipe_file(text, file);
        if (!recipe) return complain(recipe.error());
        const std::string sum = fmt::format("{:08X}", crc32_of(*recipe));
        struct stat before {
        }, after{};
        const bool known = ::stat(file.c_str(), &before) == 0;
        if (auto done = common::write_durably(file, fmt::format("crc32 = \"{}\"\n", sum) + text); !done)
            return complain(done.error());
        if (known && ::stat(file.c_str(), &after) == 0 && !lost_access(before, after).empty()) {
            print_message("hordctl: {}: {} could not be kept: give them back as root: chown {}:{} {}\n", file,
                          lost_access(before, after), before.st_uid, before.st_gid, file);
        }
        fmt::print("{}: sealed with {}\n", file, sum);
    }
    return Exit::good;
}

Exit use(const RecipeOptions& options) {
    std::uint32_t crc = 0;
    if (!options.crc32.empty()) crc = static_cast<std::uint32_t>(std::stoul(options.crc32, nullptr, 16));
    return send_command(options.remote, Command::use_recipe, options.number, crc);
}

}  // namespace

void add_recipe(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("recipe", "Recipes: list, check, seal, and have a station use one");
    command->require_subcommand(1);
    auto options = std::make_shared<RecipeOptions>();
    auto* listing = command->add_subcommand("list", "The recipes of a folder");
    listing->add_option("folder", options->folder, "Folder")->capture_default_str();
    listing->footer("Example: hordctl recipe list deploy/recipes");
    listing->callback([options, &status] { status = list(*options); });
    auto* checking = command->add_subcommand("check", "Whether files can be used; every problem, with its line");
    checking->add_option("files", options->files, "Recipe files")->required();
    checking->footer(
        "The size of the field is not known here: `hordd --check` and `hordctl inspect` also refuse a rim_margin that "
        "leaves nothing of it, and zones outside it.\nExample: hordctl recipe check deploy/recipes/default.toml");
    checking->callback([options, &status] { status = check(*options); });
    auto* sealing = command->add_subcommand(
        "seal", "Write the CRC-32 into files: a sealed recipe that somebody changes is refused");
    sealing->add_option("files", options->files, "Recipe files")->required();
    sealing->footer("Example: hordctl recipe seal /etc/hord/recipes/bottle.toml");
    sealing->callback([options, &status] { status = seal(*options); });
    auto* using_it = command->add_subcommand(
        "use", "Have a station judge with the recipe of this number; refused while it executes");
    using_it->add_option("number", options->number, "Its number")->required();
    using_it->add_option("--crc32", options->crc32, "Only if it has this CRC-32 (8 hexadecimal digits)")
        ->check(CLI::Validator(
            [](const std::string& text) {
                return text.size() == 8 && text.find_first_not_of("0123456789abcdefABCDEF") == std::string::npos
                    ? std::string()
                    : "write 8 hexadecimal digits";
            },
            "HEX"));
    add_remote_options(*using_it, options->remote);
    using_it->footer("Example: hordctl recipe use 7 --modbus 192.168.1.20:502");
    using_it->callback([options, &status] { status = use(*options); });
}

}  // namespace hord::firmware
