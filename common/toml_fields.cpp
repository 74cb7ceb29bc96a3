#include "common/toml_fields.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <set>

#include <fmt/format.h>

#include "common/file_writing.h"
#include "common/nearest_name.h"
#include "common/toml_library.h"

namespace hord::common {

void TomlProblems::add_unknown(std::string what, std::string cure) {
    problems_.insert(problems_.begin() + unknown_++, {ErrorCode::invalid_argument, std::move(what), std::move(cure)});
}

void TomlProblems::remove(const std::string& line) {
    std::erase_if(problems_, [&](const Error& problem) { return problem.message() == line; });
}

std::vector<std::string> TomlProblems::lines() const {
    std::vector<std::string> lines;
    for (const Error& problem : problems_) lines.push_back(problem.message());
    return lines;
}

tl::unexpected<Error> TomlProblems::as_error() const {
    if (problems_.size() == 1) return fail(code_, problems_[0].what, problems_[0].cure);
    return fail(code_, fmt::format("{}", fmt::join(lines(), "\n")));
}

struct TomlTable::Node {
    // Shared by all tables of the file.
    std::shared_ptr<const toml::table> file;
    const toml::table* table = nullptr;
    std::string name;  // of the file
    std::string path;  // of this table inside it, "" for the root, else "light."
    TomlProblems* problems = nullptr;
    std::vector<std::shared_ptr<const bool>> above = {};            // `misread` of the tables that it is in
    std::shared_ptr<bool> misread = std::make_shared<bool>(false);  // a choice was none of the names
    std::set<std::string, std::less<>> read_keys = {};
    std::vector<std::string> of_absent_keys = {};  // lines of problem()
    std::deque<std::shared_ptr<Node>> sub_tables = {};

    const toml::node* find(std::string_view key) {
        read_keys.emplace(key);
        return table->get(key);
    }
    [[nodiscard]] std::string line_of(const toml::node& at, std::string_view key, std::string_view what) const {
        const auto line = at.source().begin.line;
        return line > 0 ? fmt::format("{}:{}: {}{}: {}", name, line, path, key, what)
                        : fmt::format("{}: {}{}: {}", name, path, key, what);
    }
    void report(const toml::node& at, std::string_view key, std::string_view what, std::string_view cure) const {
        problems->add(line_of(at, key, what), std::string(cure));
    }
    // None: the key is absent, or its value is not of this type, which is a problem.
    template <class T>
    std::optional<T> value(std::string_view key, std::string_view wrong, std::string_view cure) {
        const toml::node* node = find(key);
        if (node == nullptr) return std::nullopt;
        auto value = node->value_exact<T>();
        if (!value) report(*node, key, wrong, cure);
        return value;
    }
    template <class T>
    std::optional<T> in_range(std::string_view key, std::optional<T> value, T low, T high) {
        if (!value || (*value >= low && *value <= high)) return value;
        report(*find(key), key, fmt::format("{} is out of range", *value), fmt::format("use {} to {}", low, high));
        return std::nullopt;
    }
    template <class T, class Accept>
    std::optional<std::vector<T>> list(std::string_view key, std::string_view wrong, std::string_view cure,
                                       Accept accept) {
        const toml::node* node = find(key);
        if (node == nullptr) return std::nullopt;
        std::vector<T> values;
        const toml::array* array = node->as_array();
        bool good = array != nullptr;
        for (std::size_t k = 0; good && k < array->size(); ++k) {
            const std::optional<T> element = (*array)[k].value<T>();
            good = element && accept((*array)[k], *element);
            if (good) values.push_back(*element);
        }
        if (good) return values;
        report(*node, key, wrong, cure);
        return std::nullopt;
    }
    std::shared_ptr<Node> add_sub_table(const toml::table& sub, std::string sub_path) {
        auto node = std::make_shared<Node>(Node{file, &sub, name, std::move(sub_path), problems, above});
        node->above.push_back(misread);
        sub_tables.push_back(node);
        return node;
    }
};

// Whether the column (from 1) is behind the last character of the line (from 1).
static bool ends_line(std::string_view text, std::size_t line, std::size_t column) {
    for (; line > 1 && text.find('\n') != std::string_view::npos; --line) text.remove_prefix(text.find('\n') + 1);
    const auto end = std::min(text.find('\n'), text.size());
    return column > std::min(text.find('\r'), end);
}

// Of a syntax error, by what toml++ says of it.
static std::string_view cure_of(std::string_view description) {
    const auto says = [&](std::string_view words) { return description.find(words) != std::string_view::npos; };
    if (says("utf-8") || says("UTF-16") || says("UTF-32") || says("u0000")) return "save the file as UTF-8";
    constexpr std::string_view kLine = "write each line as key = value, [section] or # comment";
    if (says("key-value pair: expected") && !says("expected value")) return kLine;
    if (says("redefine")) return "take one of them out";
    if (says("table header") || says("table name"))
        return "write a section's head as [name], that of a list's entry as [[name]]";
    if (says("string")) return "close a text with its quote";
    if (says("array")) return "write a list as [1.0, 2.0], a comma between its entries";
    if (says("value")) return "write a text in quotes, a number in digits, or true or false";
    return kLine;
}

// What a file that lost its end breaks off in, by what toml++ says of it.
static std::string_view broken_part(std::string_view description) {
    const auto says = [&](std::string_view words) { return description.find(words) != std::string_view::npos; };
    if (says("table header") || says("table name")) return "a section's head";
    if (says("array")) return "a list";
    if (says("string")) return "a text";
    return says("key") ? "a line" : "a value";
}

TomlTable TomlTable::parse_text(std::string_view text, std::string_view name, TomlProblems& problems) {
    auto file = std::make_shared<toml::table>();
    try {
        *file = toml::parse(text, name);
    } catch (const toml::parse_error& error) {
        const auto at = error.source().begin;
        if (ends_line(text, at.line, at.column) &&
            error.description().find("control characters") != std::string_view::npos) {
            problems.add(fmt::format("{}:{}: a text is not closed", name, at.line),
                         "write its second quote on the same line");
        } else if (error.description().find("end-of-file") != std::string_view::npos) {
            problems.add(fmt::format("{}:{}: not valid TOML: the file ends in the middle of {}", name, at.line,
                                     broken_part(error.description())),
                         fmt::format("{}; if it was longer, restore it from a copy", cure_of(error.description())));
        } else {
            problems.add(fmt::format("{}:{}: not valid TOML ({})", name, at.line, error.description()),
                         std::string(cure_of(error.description())));
        }
    }
    const toml::table* root = file.get();
    return TomlTable(std::make_shared<Node>(Node{std::move(file), root, std::string(name), "", &problems}));
}

Result<void> refuse_blank(std::string_view text, const std::filesystem::path& file) {
    if (text.find_first_not_of(" \t\r\n") != std::string_view::npos) return {};
    return fail(ErrorCode::invalid_argument, file.string() + ": is empty", "write it again, or remove it");
}

std::optional<Error> may_have_lost_its_end(const std::filesystem::path& file) {
    const std::string text = read_file(file, kMaxText).value_or("\n");
    if (text.ends_with('\n')) return std::nullopt;
    return Error{
        ErrorCode::invalid_argument,
        fmt::format("{}:{}: the last line has no line end, so the file may have lost its end, and defaults count "
                    "for what is lost",
                    file.string(), 1 + std::ranges::count(text, '\n')),
        "compare it with its original, and end it with a line end"};
}

TomlTable TomlTable::parse_file(const std::filesystem::path& file, TomlProblems& problems) {
    const auto text = read_file(file, kMaxText);
    if (!text) problems.add(cannot_read(file));
    else if (auto fine = refuse_blank(*text, file); !fine) problems.add(fine.error());
    return parse_text(text.value_or(""), file.string(), problems);
}

namespace {

// The system would end a path there, and a protocol a name.
bool has_nul(const std::string& text) { return text.find('\0') != std::string::npos; }
constexpr std::string_view kNul = "holds a NUL character", kNoNul = "take \\u0000 out";

// Of a value that is no number, or no whole one.
std::string_view cure_of_number(const toml::node* node) {
    if (node != nullptr && node->is_string()) return "write one without quotes";
    if (node != nullptr && node->is_floating_point()) return "write one without decimals";
    return "write digits";
}

}  // namespace

std::optional<double> TomlTable::read_number(std::string_view key, double low, double high) {
    const toml::node* node = node_->find(key);
    const auto value = node != nullptr && node->is_integer()
        ? std::optional(static_cast<double>(node->as_integer()->get()))
        : node_->value<double>(key, "is not a number", cure_of_number(node));
    return node_->in_range(key, value, low, high);
}

std::optional<std::int64_t> TomlTable::read_integer(std::string_view key, std::int64_t low, std::int64_t high) {
    const auto value = node_->value<std::int64_t>(key, "is not a whole number", cure_of_number(node_->find(key)));
    return node_->in_range(key, value, low, high);
}

void TomlTable::boolean(std::string_view key, bool& value) {
    if (const auto read = node_->value<bool>(key, "is neither true nor false", "write true or false, without quotes"))
        value = *read;
}

void TomlTable::text(std::string_view key, std::string& value) {
    auto read = node_->value<std::string>(key, "is not a text", "write it in quotes");
    if (!read) return;
    if (has_nul(*read)) node_->report(*node_->find(key), key, kNul, kNoNul);
    else value = std::move(*read);
}

void TomlTable::name(std::string_view key, std::string& value) {
    text(key, value);
    if (!has(key)) return;
    if (value.empty()) problem(key, "is empty", "give a name, or take it out");
    if (std::ranges::any_of(value, [](unsigned char c) { return c < 0x20 || c == 0x7F; }))
        problem(key, "holds a control character such as a line's end", "write it in one line");
}

void TomlTable::scalar(std::string_view key, std::string& value) {
    const toml::node* node = node_->find(key);
    if (node == nullptr) return;
    if (node->is_string() && has_nul(node->as_string()->get())) node_->report(*node, key, kNul, kNoNul);
    else if (node->is_string()) value = node->as_string()->get();
    else if (node->is_integer()) value = fmt::format("{}", node->as_integer()->get());
    else if (node->is_floating_point() && std::isfinite(node->as_floating_point()->get()))
        value = fmt::format("{}", node->as_floating_point()->get());
    else if (node->is_boolean()) value = node->as_boolean()->get() ? "true" : "false";
    else node_->report(*node, key, "is neither a text, a finite number, true nor false", "write one of these");
}

void TomlTable::numbers(std::string_view key, std::vector<double>& values, std::size_t min_count,
                        std::size_t max_count) {
    auto read = node_->list<double>(
        key, "is not a list of numbers", "write [1.0, 2.0]",
        [](const toml::node& element, double number) { return element.is_number() && std::isfinite(number); });
    if (!read) return;
    if (read->size() < min_count || read->size() > max_count) {
        return problem(key, fmt::format("has {} numbers", read->size()),
                       min_count == max_count ? fmt::format("give {}", min_count)
                                              : fmt::format("give {} to {}", min_count, max_count));
    }
    values = std::move(*read);
}

void TomlTable::texts(std::string_view key, std::vector<std::string>& values) {
    auto read =
        node_->list<std::string>(key, "is not a list of texts", "write [\"a\", \"b\"]",
                                 [](const toml::node& element, const std::string&) { return element.is_string(); });
    if (read && std::ranges::any_of(*read, has_nul)) node_->report(*node_->find(key), key, kNul, kNoNul);
    else if (read) values = std::move(*read);
}

std::optional<std::size_t> TomlTable::choice(std::string_view key, std::span<const std::string_view> names) {
    const toml::node* node = node_->find(key);
    if (node == nullptr) return std::nullopt;
    const std::string given = node->is_string() ? node->as_string()->get() : std::string("(not a text)");
    const auto found = std::find(names.begin(), names.end(), given);
    if (found == names.end()) {
        const auto nearest = nearest_name(given, names);
        *node_->misread = true;
        node_->report(*node, key, fmt::format("\"{}\" is not known", given),
                      fmt::format("{}one of {}", nearest ? "did you mean " + *nearest + "? It is " : "use ",
                                  fmt::join(names, ", ")));
        return std::nullopt;
    }
    return static_cast<std::size_t>(found - names.begin());
}

TomlTable TomlTable::table(std::string_view key) {
    static const toml::table empty;
    const toml::node* node = node_->find(key);
    const toml::table* sub = node != nullptr ? node->as_table() : nullptr;
    if (node != nullptr && sub == nullptr)
        node_->report(*node, key, "is not a table", fmt::format("write [{}{}]", node_->path, key));
    return TomlTable(node_->add_sub_table(sub != nullptr ? *sub : empty, fmt::format("{}{}.", node_->path, key)));
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) {
    std::vector<TomlTable> all;
    const toml::node* node = node_->find(key);
    if (node == nullptr) return all;
    const toml::array* array = node->as_array();
    if (array == nullptr ||
        !std::all_of(array->begin(), array->end(), [](const toml::node& n) { return n.is_table(); })) {
        node_->report(*node, key, "is not a list of tables", fmt::format("write [[{}{}]] for each", node_->path, key));
        return all;
    }
    for (std::size_t k = 0; k < array->size(); ++k) {
        all.push_back(
            TomlTable(node_->add_sub_table(*(*array)[k].as_table(), fmt::format("{}{}[{}].", node_->path, key, k))));
    }
    return all;
}

bool TomlTable::has(std::string_view key) const { return node_->find(key) != nullptr; }

bool TomlTable::misread() const {
    return *node_->misread || std::ranges::any_of(node_->above, [](const auto& one) { return *one; });
}

void TomlTable::problem(std::string_view key, std::string_view what, std::string_view cure) {
    if (misread()) return;
    const toml::node* node = node_->find(key);
    const Error error{ErrorCode::invalid_argument, node_->line_of(node != nullptr ? *node : *node_->table, key, what),
                      std::string(cure)};
    if (node == nullptr) node_->of_absent_keys.push_back(error.message());
    node_->problems->add(error.what, error.cure);
}

void TomlTable::refuse_unknown_keys() {
    for (const auto& [key, value] : *node_->table) {
        const std::string_view unknown = key.str();
        if (node_->read_keys.contains(unknown)) continue;
        const auto nearest = nearest_name(unknown, node_->read_keys);
        if (nearest)
            std::ranges::for_each(node_->of_absent_keys, [&](const auto& line) { node_->problems->remove(line); });
        node_->problems->add_unknown(node_->line_of(value, unknown, "is not a known key"),
                                     nearest ? fmt::format("did you mean {}?", *nearest) : "remove it");
    }
    for (const auto& sub : node_->sub_tables) TomlTable(sub).refuse_unknown_keys();
}

}  // namespace hord::common
