// Reads a TOML file into structs with defaults, strictly: unknown keys, wrong types and values out of range are
// problems. All problems are reported at once, each with file, line and cure.
//
//     TomlProblems problems;
//     auto root = TomlTable::parse_file(file, problems);        // a syntax error is a problem, too
//     TomlTable light = root.table("light");                    // absent: an empty table, defaults stay
//     light.number("radius_bins", scene.radius_bins, 0.0, 4.0); // keeps the default when the key is absent
//     root.refuse_unknown_keys();                               // this table and every table taken from it
//     if (!problems.empty()) return problems.as_error();
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/result.h"

namespace hord::common {

class TomlProblems {
  public:
    void add(std::string what, std::string cure) {
        problems_.push_back({ErrorCode::invalid_argument, std::move(what), std::move(cure)});
    }
    // A name that is not known: told before all others, which may follow from it ("backend is missing").
    void add_unknown(std::string what, std::string cure);
    void remove(const std::string& line);
    void add(const Error& error) {
        code_ = error.code;
        problems_.push_back(error);
    }
    [[nodiscard]] bool empty() const { return problems_.empty(); }
    // Each problem with its cure (Error::message).
    [[nodiscard]] std::vector<std::string> lines() const;
    // The only problem. Of several, `what` holds each with its cure, one a line, and `cure` is empty. The code is
    // invalid_argument, or that of the last Error.
    [[nodiscard]] tl::unexpected<Error> as_error() const;

  private:
    std::vector<Error> problems_;
    std::ptrdiff_t unknown_ = 0;  // of them, the first ones
    ErrorCode code_ = ErrorCode::invalid_argument;
};

// Fails with invalid_argument for a file of no text, as a disk that was full leaves it: its defaults are not meant.
Result<void> refuse_blank(std::string_view text, const std::filesystem::path& file);

// Told, not refused, of a configuration that a program has been started with for long: its last line has no line end,
// as where the file was cut. None: it has one, or the file cannot be read.
std::optional<Error> may_have_lost_its_end(const std::filesystem::path& file);

class TomlTable {
  public:
    // An unreadable file, a blank one or a syntax error adds a problem and returns an empty table. `problems` must
    // outlive the table.
    static TomlTable parse_file(const std::filesystem::path& file, TomlProblems& problems);
    static TomlTable parse_text(std::string_view text, std::string_view name, TomlProblems& problems);

    // Each reads one key. An absent key does not change `value`; a wrong type or a value outside [low, high] adds a
    // problem and does not change it either. An integer is accepted as a number, but not the reverse.
    template <class Float>
    requires std::is_floating_point_v<Float>
    void number(std::string_view key, Float& value, double low, double high) {
        if (auto read = read_number(key, low, high)) value = static_cast<Float>(*read);
    }
    template <class Int>
    requires std::is_integral_v<Int>
    void integer(std::string_view key, Int& value, std::int64_t low, std::int64_t high) {
        if (auto read = read_integer(key, low, high)) value = static_cast<Int>(*read);
    }
    void boolean(std::string_view key, bool& value);
    // Refuses a NUL, as every reading of a text does.
    void text(std::string_view key, std::string& value);
    // A text that people, tables and protocols call something by: refuses "" and control characters.
    void name(std::string_view key, std::string& value);
    // A text, a number or a boolean, as text.
    void scalar(std::string_view key, std::string& value);
    void numbers(std::string_view key, std::vector<double>& values, std::size_t min_count, std::size_t max_count);
    void texts(std::string_view key, std::vector<std::string>& values);

    // One of the given names, as an index into them; in the second form also as the enumerator or bool of that number.
    // Any other name adds a problem that suggests the most similar of the given names.
    [[nodiscard]] std::optional<std::size_t> choice(std::string_view key, std::span<const std::string_view> names);
    template <class Value>
    void choice(std::string_view key, std::initializer_list<std::string_view> names, Value& value) {
        if (const auto read = choice(key, std::span(names.begin(), names.size()))) value = static_cast<Value>(*read);
    }

    // A sub-table, empty if absent. An array of tables, empty if absent.
    [[nodiscard]] TomlTable table(std::string_view key);
    [[nodiscard]] std::vector<TomlTable> tables(std::string_view key);
    [[nodiscard]] bool has(std::string_view key) const;

    // Adds a problem at the line of `key` (of the table, where the key is absent): for checks across keys. Adds nothing
    // when misread(): it may follow from that.
    void problem(std::string_view key, std::string_view what, std::string_view cure);
    // A choice() of this table, or of a table that contains it, found none of the given names.
    [[nodiscard]] bool misread() const;

    // Adds a problem, with the most similar known key, for every key of this table and its sub-tables that was not
    // read. If one is similar, what problem() added to keys that are absent is removed: it may follow from it.
    void refuse_unknown_keys();

  private:
    struct Node;
    explicit TomlTable(std::shared_ptr<Node> node) : node_(std::move(node)) {}
    std::optional<std::int64_t> read_integer(std::string_view key, std::int64_t low, std::int64_t high);
    std::optional<double> read_number(std::string_view key, double low, double high);
    std::shared_ptr<Node> node_;
};

}  // namespace hord::common
