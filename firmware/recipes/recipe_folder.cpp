#include "firmware/recipes/recipe_folder.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <functional>
#include <iterator>
#include <system_error>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/file_writing.h"
#include "common/toml_fields.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kHead = "# In use since it was committed. Configured then: ";
constexpr std::string_view kContent = "# Checksum with its reference: ";
constexpr std::string_view kSeal = "# crc32 ";
constexpr std::uintmax_t kMaxBytes = 16'000'000;  // a recipe in use is not read into more memory

// A comment of the file: the key and a CRC-32.
std::string line(std::string_view key, std::uint32_t crc) { return fmt::format("{}{:08X}\n", key, crc); }
constexpr std::size_t length(std::string_view key) { return key.size() + 9; }

// The CRC-32 of the line at the text's begin. None: the text does not begin with such a line.
std::optional<std::uint32_t> value_of(std::string_view text, std::string_view key) {
    std::uint32_t crc = 0;
    if (!text.starts_with(key) || text.size() < length(key)) return std::nullopt;
    const char* const digits = text.data() + key.size();
    if (std::from_chars(digits, digits + 8, crc, 16).ptr != digits + 8 || digits[8] != '\n') return std::nullopt;
    return crc;
}

// All *.toml files of the folder, sorted by name.
Result<std::vector<fs::path>> recipe_files(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> files;
    for (auto entry = fs::directory_iterator(folder, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
        if (entry->path().extension() == ".toml") files.push_back(entry->path());
    }
    if (error) {
        const bool is_missing = error == std::errc::no_such_file_or_directory;
        const std::string cure = is_missing         ? "make it, or "
            : error == std::errc::permission_denied ? "give this user the right to read it, or "
                                                    : "";
        return fail(is_missing ? ErrorCode::not_found : ErrorCode::unreadable,
                    fmt::format("the folder of recipes {}: {}", folder.string(), error.message()),
                    cure + "name another one in inspection.recipes");
    }
    std::sort(files.begin(), files.end());
    return files;
}

// What a file without a checksum has lost at its end, compared with the recipe of its name; empty: nothing. A commit
// and a teach-in change no zone and no tolerance, and take no reference away. `which`: "the configured recipe".
std::string lacks(const NumberedRecipe& kept, const NumberedRecipe& original, std::string_view which) {
    const algo::Recipe &now = kept.recipe, &then = original.recipe;
    if (now.zones.size() < then.zones.size())
        return fmt::format("it has {} of the {} zones of {}", now.zones.size(), then.zones.size(), which);
    if (now.tolerances.size() < then.tolerances.size())
        return fmt::format("it has {} of the {} tolerances of {}", now.tolerances.size(), then.tolerances.size(),
                           which);
    if (kept.reference_file.empty() && !original.reference_file.empty())
        return fmt::format("it lacks the reference of {}", which);
    return {};
}

// The same of a kept recipe that may be the configured one or another of the folder; of one that is neither, nothing.
std::string what_was_cut(const NumberedRecipe& kept, const NumberedRecipe& configured, const fs::path& recipes) {
    if (kept.recipe.name == configured.recipe.name) return lacks(kept, configured, "the configured recipe");
    if (recipes.empty()) return {};
    const auto selected = find_recipe(recipes, kept.number);
    if (!selected || selected->recipe.name != kept.recipe.name) return {};
    return lacks(kept, *selected, fmt::format("recipe {} in {}", kept.number, recipes.string()));
}

// What a file says of itself, whatever else is wrong with it; its reference is not read.
struct RecipeHead {
    fs::path file;
    std::uint16_t number = 0;
    fs::path reference = {};  // empty: none
    bool says_number = true;  // false: the default counts, or its key is misspelt
};

// Fails with the problems of a file whose number or reference cannot be told.
Result<RecipeHead> head_of(const fs::path& file) {
    common::TomlProblems unreadable;
    RecipeHead head{.file = file};
    common::TomlTable root = common::TomlTable::parse_file(file, unreadable);
    root.integer("number", head.number, 0, 65534);
    head.says_number = root.has("number");
    std::string reference;
    root.table("reference").text("file", reference);
    if (!unreadable.empty()) return unreadable.as_error();
    if (!reference.empty()) head.reference = reference_path(reference, fs::absolute(file).parent_path());
    return head;
}

// Paths in the folder lose it: remarks are short.
std::string without_folder(std::string text, const fs::path& folder) {
    for (const std::string& prefix : {fs::absolute(folder).string() + "/", folder.string() + "/"}) {
        for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix, at)) {
            if (at == 0 || text[at - 1] == ' ' || text[at - 1] == '\n') text.erase(at, prefix.size());
            else ++at;
        }
    }
    return text;
}

// Without those that cannot be told.
std::vector<RecipeHead> heads_of(const std::vector<fs::path>& files) {
    std::vector<RecipeHead> heads;
    for (const fs::path& file : files) {
        if (auto head = head_of(file)) heads.push_back(std::move(*head));
    }
    return heads;
}

// A link to a file beside it is that file. Files of different folders may have one number: nobody selects among them.
Result<void> refuse_doubled(const std::vector<RecipeHead>& files) {
    std::string doubled;
    for (std::size_t k = 0; k < files.size(); ++k) {
        for (std::size_t other = 0; other < k; ++other) {
            const RecipeHead &a = files[other], &b = files[k];
            if (a.number != b.number) continue;
            std::error_code error;
            if (fs::equivalent(a.file, b.file, error) ||
                fs::weakly_canonical(a.file.parent_path(), error) != fs::weakly_canonical(b.file.parent_path(), error))
                continue;
            doubled += fmt::format("{}{} and {} both have number {}", doubled.empty() ? "" : ", ", a.file.string(),
                                   b.file.string(), a.number);
            break;
        }
    }
    if (doubled.empty()) return {};
    return fail(ErrorCode::refused, doubled, "give each recipe a number of its own");
}

}  // namespace

Result<std::vector<RecipeEntry>> list_recipes(const fs::path& folder) {
    const auto files = recipe_files(folder);
    if (!files) return tl::unexpected(files.error());
    std::vector<RecipeEntry> all;
    for (const fs::path& file : *files) all.push_back({file, load_numbered_recipe(file)});
    return all;
}

Result<void> check_numbers(const std::vector<RecipeEntry>& recipes) {
    std::vector<RecipeHead> files;
    for (const RecipeEntry& entry : recipes) {
        if (entry.recipe) files.push_back({.file = entry.file, .number = entry.recipe->number});
    }
    return refuse_doubled(files);
}

Result<void> check_recipe_numbers(const fs::path& folder) {
    if (folder.empty()) return {};
    return recipe_files(folder).and_then([](const auto& files) { return refuse_doubled(heads_of(files)); });
}

std::vector<Error> missing_references(const fs::path& folder) {
    std::vector<Error> all;
    if (folder.empty()) return all;
    for (const RecipeHead& head : heads_of(recipe_files(folder).value_or(std::vector<fs::path>()))) {
        if (head.reference.empty()) continue;
        if (const auto facts = read_reference_facts(head.reference); !facts) {
            const Error& why = facts.error();
            all.push_back({why.code, fmt::format("{}: its reference {}", head.file.string(), why.what), why.cure});
        }
    }
    return all;
}

Result<NumberedRecipe> find_recipe(const fs::path& folder, std::uint16_t number) {
    const auto files = recipe_files(folder);
    if (!files) return tl::unexpected(files.error());
    std::vector<RecipeHead> asked;
    std::string unusable;
    for (const fs::path& file : *files) {
        const auto head = head_of(file);
        if (head && head->number == number) {
            asked.push_back(*head);
        } else if (!head) {
            unusable += "; " + head.error().message();
        } else if (!head->says_number) {  // its key may be misspelt
            if (const auto whole = load_numbered_recipe(file); !whole) unusable += "; " + whole.error().message();
        }
    }
    if (auto unique = refuse_doubled(asked); !unique) return tl::unexpected(unique.error());
    if (asked.empty()) {
        return fail(ErrorCode::not_found,
                    fmt::format("no recipe in {} has number {}{}", folder.string(), number, unusable),
                    "hordctl recipe list shows which there are");
    }
    const fs::path& file = asked.front().file;
    return load_numbered_recipe(file).map_error([&](Error error) {
        error.what = fmt::format("recipe {} cannot be used: {}", number, without_folder(error.what, folder));
        return error;
    });
}

Result<void> remember_recipe(const fs::path& file, std::uint32_t configured, const NumberedRecipe& in_use) {
    const std::string text =
        line(kHead, configured) + line(kContent, crc32_of(in_use)) + format_recipe_in(file.parent_path(), in_use);
    return common::write_durably(file, text + line(kSeal, common::crc32(text)));
}

fs::path damaged_recipe(const fs::path& file) { return file.string() + ".damaged"; }

namespace {

// `on_damage` says what becomes of a damaged file.
Result<std::optional<RememberedRecipe>> read_remembered(const fs::path& file, const NumberedRecipe& configured,
                                                        const fs::path& recipes,
                                                        const std::function<Error(std::string_view why)>& on_damage) {
    const auto damaged = [&](std::string_view why) { return tl::unexpected(on_damage(why)); };
    std::error_code none;
    const fs::file_type kind = fs::status(file, none).type();
    if (kind != fs::file_type::regular && fs::exists(fs::symlink_status(file, none)))
        return damaged(kind == fs::file_type::directory ? "it is a folder" : "it is no regular file");
    if (const auto size = fs::file_size(file, none); !none && size > kMaxBytes)
        return damaged(fmt::format("it has {} bytes", size));
    const auto read = common::read_file(file);
    if (!read && errno == ENOENT) return std::nullopt;
    if (!read) {
        Error error = common::cannot_read(file);
        error.cure = "move it away, then commit or select the recipe again";
        return tl::unexpected(error);
    }
    std::string_view text = *read;
    const auto seal = value_of(text.substr(text.size() - std::min(text.size(), length(kSeal))), kSeal);
    if (seal) text.remove_suffix(length(kSeal));
    if (seal && *seal != common::crc32(text)) return damaged("its content does not have the checksum of its last line");
    const auto head = value_of(text, kHead);
    if (!head) return damaged("its first line is not that of a recipe in use");
    text.remove_prefix(length(kHead));
    const auto content = value_of(text, kContent);
    if (content) text.remove_prefix(length(kContent));
    if (content && !seal) return damaged("its last line, the checksum, is missing");
    if (!text.ends_with('\n')) return damaged("its last line has no line end");
    if (*head != crc32_of(configured)) {
        // The path may be absolute, as an earlier version wrote it.
        if (content && (text == format_recipe_in(file.parent_path(), configured) || text == format_recipe(configured)))
            return RememberedRecipe{*content, configured};  // with another reference
        if (!content) return std::nullopt;
        return RememberedRecipe{*content, std::nullopt};
    }
    auto recipe = parse_numbered_recipe(*read, file.string(), kMaxArea, fs::absolute(file).parent_path());
    if (!recipe) return tl::unexpected(recipe.error());
    if (!recipe->unset_limits.empty()) return damaged("limits are missing that it always has");
    if (!content) {
        const std::string lost = what_was_cut(*recipe, configured, recipes);
        if (!lost.empty()) return damaged(lost);
    }
    return RememberedRecipe{content.value_or(0), std::move(*recipe)};
}

}  // namespace

Result<std::optional<RememberedRecipe>> remembered_recipe(const fs::path& file, const NumberedRecipe& configured,
                                                          const fs::path& recipes) {
    return read_remembered(file, configured, recipes, [&](std::string_view why) {
        std::error_code error;
        fs::rename(file, damaged_recipe(file), error);
        return Error{ErrorCode::invalid_argument,
                     fmt::format("{} is damaged ({}) and {}", file.string(), why,
                                 error ? "cannot be renamed: " + error.message()
                                       : "was renamed " + damaged_recipe(file).filename().string()),
                     error ? "remove it by hand, then commit or select the recipe again"
                           : "commit or select the recipe again, or remove that file and restart"};
    });
}

Result<std::optional<RememberedRecipe>> look_at_remembered(const fs::path& file, const NumberedRecipe& configured,
                                                           const fs::path& recipes) {
    return read_remembered(file, configured, recipes, [&](std::string_view why) {
        return Error{ErrorCode::invalid_argument, fmt::format("{} is damaged ({})", file.string(), why),
                     "the next start uses the configured recipe: commit or select the recipe again then"};
    });
}

std::string recorded_recipe(const NumberedRecipe& recipe) {
    const auto& reference = recipe.recipe.reference;
    return format_recipe(recipe) +
        (reference ? fmt::format("# crc32 of the reference: {:08X}\n", crc32_of(reference)) : "");
}

}  // namespace hord::firmware
