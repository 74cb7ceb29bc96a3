#include "common/toml_fields.h"

#include <array>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/nearest_name.h"

namespace hord::common {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(TomlFields, absent_keys_keep_their_defaults_and_present_ones_are_read) {
    TomlProblems problems;
    auto root =
        TomlTable::parse_text("[light]\nradius = 2\nname = \"red\"\non = true\nat = [1, 2.5]\n", "a.toml", problems);
    auto light = root.table("light");
    double radius = 1, power = 7;
    std::string name;
    bool on = false;
    std::vector<double> at;
    light.number("radius", radius, 0, 10);
    light.number("power", power, 0, 10);
    light.text("name", name);
    light.boolean("on", on);
    light.numbers("at", at, 2, 2);
    root.refuse_unknown_keys();
    EXPECT_THAT(problems.lines(), IsEmpty());
    EXPECT_EQ(radius, 2);
    EXPECT_EQ(power, 7);
    EXPECT_EQ(name, "red");
    EXPECT_TRUE(on);
    EXPECT_THAT(at, ElementsAre(1, 2.5));
}

TEST(TomlFields, what_is_no_number_gets_the_cure_of_what_it_is) {
    TomlProblems problems;
    auto root = TomlTable::parse_text("a = true\nb = \"1\"\nc = true\nd = 1.5\n", "a.toml", problems);
    double number = 1;
    int whole = 1;
    root.number("a", number, 0, 10);
    root.number("b", number, 0, 10);
    root.integer("c", whole, 0, 10);
    root.integer("d", whole, 0, 10);
    EXPECT_THAT(problems.lines(),
                ElementsAre(HasSubstr("a: is not a number: write digits"),
                            HasSubstr("b: is not a number: write one without quotes"),
                            HasSubstr("c: is not a whole number: write digits"),
                            HasSubstr("d: is not a whole number: write one without decimals")));
}

TEST(TomlFields, every_problem_is_reported_with_file_line_and_cure) {
    TomlProblems problems;
    auto root =
        TomlTable::parse_text("count = 1.5\n[light]\nradius = 200\nwidht = 3\nkind = \"x\"\n", "a.toml", problems);
    int count = 4;
    double radius = 1, width = 1;
    root.integer("count", count, 0, 9);
    auto light = root.table("light");
    light.number("radius", radius, 0, 10);
    light.number("width", width, 0, 10);
    constexpr std::array<std::string_view, 2> kinds{"led", "laser"};
    EXPECT_FALSE(light.choice("kind", kinds));
    root.refuse_unknown_keys();
    EXPECT_THAT(problems.lines(),
                ElementsAre(HasSubstr("a.toml:4: light.widht: is not a known key: did you mean width?"),
                            HasSubstr("a.toml:1: count: is not a whole number"),
                            HasSubstr("a.toml:3: light.radius: 200 is out of range: use 0 to 10"),
                            HasSubstr("a.toml:5: light.kind: \"x\" is not known: use one of led, laser")));
    EXPECT_EQ(count, 4);
    EXPECT_EQ(radius, 1);
}

TEST(TomlFields, what_may_follow_from_a_misspelt_choice_is_not_told) {
    TomlProblems problems;
    auto root =
        TomlTable::parse_text("[light]\nkind = \"lasr\"\nwidth = 20\n[light.lens]\n[cell]\n", "a.toml", problems);
    auto light = root.table("light"), lens = light.table("lens"), cell = root.table("cell");
    constexpr std::array<std::string_view, 2> kinds{"led", "laser"};
    EXPECT_FALSE(light.misread());
    EXPECT_FALSE(light.choice("kind", kinds));
    EXPECT_TRUE(light.misread() && lens.misread());
    EXPECT_FALSE(root.misread() || cell.misread());
    double width = 1;
    light.number("width", width, 0, 10);
    light.problem("power", "is missing", "say it");
    lens.problem("focus", "is missing", "say it");
    cell.problem("name", "is missing", "say it");
    EXPECT_THAT(problems.lines(),
                ElementsAre("a.toml:2: light.kind: \"lasr\" is not known: did you mean laser? It is one of led, laser",
                            HasSubstr("light.width: 20 is out of range"), "a.toml:5: cell.name: is missing: say it"));
}

TEST(TomlFields, what_may_follow_from_a_misspelt_key_is_not_told) {
    TomlProblems problems;
    auto root = TomlTable::parse_text("[light]\nknid = \"led\"\nwidth = 3\n[cell]\nfoo = 1\n", "a.toml", problems);
    auto light = root.table("light"), cell = root.table("cell");
    std::string kind;
    int width = 0;
    light.text("kind", kind);
    light.integer("width", width, 0, 10);
    light.problem("kind", "is missing", "say it");
    light.problem("width", "is odd", "take an even one");  // a key that is there is wrong by itself
    cell.problem("name", "is missing", "say it");
    root.refuse_unknown_keys();
    EXPECT_THAT(
        problems.lines(),
        testing::UnorderedElementsAre(HasSubstr("light.knid: is not a known key: did you mean kind?"),
                                      HasSubstr("light.width: is odd: take an even one"),
                                      HasSubstr("cell.foo: is not a known key"), HasSubstr("cell.name: is missing")));
}

TEST(TomlFields, a_syntax_error_has_a_cure) {
    for (const auto& [text, cure] : {std::pair("a = word\n", "a text in quotes"),
                                     {"a = \n", "a text in quotes"},
                                     {"a = 1\na = 2\n", "take one of them out"},
                                     {"[a]\n[a]\n", "take one of them out"},
                                     {"[a\nb = 1\n", "[name]"},
                                     {"a = [1, 2\nb = 3\n", "a comma between its entries"},
                                     {"a\n", "key = value"},
                                     {"a: 1\n", "key = value"},
                                     {"a = 1 b = 2\n", "key = value"}}) {
        TomlProblems problems;
        (void)TomlTable::parse_text(text, "a.toml", problems);
        EXPECT_THAT(problems.lines(), ElementsAre(HasSubstr(cure))) << text;
    }
}

TEST(TomlFields, not_a_number_and_infinity_are_out_of_every_range) {
    TomlProblems problems;
    auto root = TomlTable::parse_text("a = nan\nb = inf\n", "a.toml", problems);
    double a = 1, b = 1;
    root.number("a", a, 0, 10);
    root.number("b", b, 0, 10);
    EXPECT_EQ(problems.lines().size(), 2U);
}

// toml++ 3.3 has undefined behaviour for such letters (common/toml_library.h): the undefined-behaviour sanitizer shows
// it.
TEST(TomlFields, letters_of_any_language_are_no_values_and_may_stand_in_strings) {
    for (const char* letter : {"\u00A7", "\u00B5", "\u01FF", "\u0416", "\u2C60", "\u3042", "\uFDF0", "\U0001F600"}) {
        SCOPED_TRACE(letter);
        for (const std::string before : {"", "5", "0x", "1979-05-27", "tru", "\"a\""}) {
            TomlProblems problems;
            TomlTable::parse_text("a = " + before + letter + "\n", "a.toml", problems);
            EXPECT_THAT(problems.lines(), ElementsAre(HasSubstr("not valid TOML"))) << before;
        }
        TomlProblems problems;
        auto root = TomlTable::parse_text(fmt::format("a = \"\"\"\\\n{}\"\"\"\n", letter), "a.toml", problems);
        std::string text;
        root.text("a", text);
        EXPECT_THAT(problems.lines(), ElementsAre());
        EXPECT_EQ(text, letter);
    }
}

TEST(NearestName, is_one_edit_in_three_letters_away_at_most) {
    const std::vector<std::string> names{"name", "host", "--good", "--last", "--macro", "transport_ms"};
    EXPECT_EQ(nearest_name("nmae", names), "name");
    EXPECT_EQ(nearest_name("hots", names), "host");
    EXPECT_EQ(nearest_name("--macroo", names), "--macro");
    EXPECT_EQ(nearest_name("transport", names), "transport_ms");
    EXPECT_EQ(nearest_name("--lust", std::vector<std::string>{"--macro", "--last", "--lost"}), "--last")
        << "the first of the nearest";
    for (const char* far : {"page", "--foo", "--part", "x", "--"})
        EXPECT_EQ(nearest_name(far, names), std::nullopt) << far;
}

TEST(TomlFields, a_text_that_is_not_closed_is_told) {
    for (const char* text :
         {"a = 1\nname = \"lens\nb = 2\n", "a = 1\nname = 'lens\n", "a = 1\nname = \"lens\r\nb = 2\n"}) {
        TomlProblems problems;
        (void)TomlTable::parse_text(text, "a.toml", problems);
        EXPECT_THAT(problems.lines(),
                    ElementsAre("a.toml:2: a text is not closed: write its second quote on the same line"))
            << text;
    }
    TomlProblems problems;
    (void)TomlTable::parse_text("name = \"a\x01z\"\n", "a.toml", problems);
    EXPECT_THAT(problems.lines(), ElementsAre(HasSubstr("a.toml:1: not valid TOML")));
}

TEST(TomlFields, a_file_that_lost_its_end_is_told_with_what_is_missing_there) {
    const std::string more = "; if it was longer, restore it from a copy";
    for (const auto& [cut, broken, cure] :
         {std::array{"[limits", "a section's head",
                     "write a section's head as [name], that of a list's entry as [[name]]"},
          {"[[zone", "a section's head", "write a section's head as [name], that of a list's entry as [[name]]"},
          {"centre = [1, ", "a list", "write a list as [1.0, 2.0], a comma between its entries"},
          {"name = \"ab", "a text", "close a text with its quote"},
          {"emd_bins", "a line", "write a text in quotes, a number in digits, or true or false"},
          {"emd_bins = 1.", "a value", "write each line as key = value, [section] or # comment"}}) {
        TomlProblems problems;
        (void)TomlTable::parse_text(fmt::format("schema = 1\n{}", cut), "a.toml", problems);
        EXPECT_THAT(problems.lines(),
                    ElementsAre(fmt::format("a.toml:2: not valid TOML: the file ends in the middle of {}: {}{}", broken,
                                            cure, more)))
            << cut;
    }
}

TEST(TomlFields, a_text_with_a_nul_is_refused_and_its_key_named) {
    TomlProblems problems;
    TomlTable root = TomlTable::parse_text(
        "a = \"x\\u0000y\"\nb = [\"x\", \"\\u0000\"]\nc = \"\\u0000\"\nd = \"x\\ty\"\n", "file", problems);
    std::string a = "as it was", c = a, d;
    std::vector<std::string> b{a};
    root.text("a", a);
    root.texts("b", b);
    root.scalar("c", c);
    root.text("d", d);
    EXPECT_THAT(problems.lines(),
                testing::ElementsAre("file:1: a: holds a NUL character: take \\u0000 out",
                                     "file:2: b: holds a NUL character: take \\u0000 out",
                                     "file:3: c: holds a NUL character: take \\u0000 out"));
    EXPECT_EQ(a + b[0] + c, "as it wasas it wasas it was");
    EXPECT_EQ(d, "x\ty");
}

TEST(TomlFields, a_file_that_is_no_utf8_gets_that_cure) {
    for (const std::string_view text :
         {std::string_view("name = \"S\xFC"
                           "d\"\n"),
          std::string_view("\xFF\xFE[\0a\0]\0\n\0", 10), std::string_view("[\0a\0]\0\n\0", 8)}) {
        TomlProblems problems;
        (void)TomlTable::parse_text(text, "file", problems);
        ASSERT_EQ(problems.lines().size(), 1U);
        EXPECT_THAT(problems.lines()[0], testing::EndsWith(": save the file as UTF-8"));
    }
}

TEST(TomlFields, a_problem_has_its_cure_apart_from_what_is_wrong) {
    for (const auto& [text, what, cure] :
         {std::tuple("flag = 1\n", "a.toml:1: flag: is neither true nor false", "write true or false, without quotes"),
          {"any = [1]\n", "a.toml:1: any: is neither a text, a finite number, true nor false", "write one of these"},
          {"text = 1\n", "a.toml:1: text: is not a text", "write it in quotes"},
          {"text = \"a\\u0000\"\n", "a.toml:1: text: holds a NUL character", "take \\u0000 out"},
          {"name = \"\"\n", "a.toml:1: name: is empty", "give a name, or take it out"},
          {"number = \"1\"\n", "a.toml:1: number: is not a number", "write one without quotes"},
          {"number = 11\n", "a.toml:1: number: 11 is out of range", "use 0 to 10"},
          {"numbers = 1\n", "a.toml:1: numbers: is not a list of numbers", "write [1.0, 2.0]"},
          {"numbers = [1]\n", "a.toml:1: numbers: has 1 numbers", "give 2"},
          {"texts = 1\n", "a.toml:1: texts: is not a list of texts", "write [\"a\", \"b\"]"},
          {"kind = \"x\"\n", "a.toml:1: kind: \"x\" is not known", "use one of led, laser"},
          {"light = 1\n", "a.toml:1: light: is not a table", "write [light]"},
          {"lights = 1\n", "a.toml:1: lights: is not a list of tables", "write [[lights]] for each"},
          {"numbres = []\n", "a.toml:1: numbres: is not a known key", "did you mean numbers?"},
          {"text = \"a\nname = 1\n", "a.toml:1: a text is not closed", "write its second quote on the same line"}}) {
        TomlProblems problems;
        auto root = TomlTable::parse_text(text, "a.toml", problems);
        bool flag = false;
        std::string any, name;
        double number = 0;
        std::vector<double> numbers;
        std::vector<std::string> texts;
        root.boolean("flag", flag);
        root.scalar("any", any);
        root.text("text", any);
        root.name("name", name);
        root.number("number", number, 0, 10);
        root.numbers("numbers", numbers, 2, 2);
        root.texts("texts", texts);
        (void)root.choice("kind", std::array<std::string_view, 2>{"led", "laser"});
        (void)root.table("light");
        (void)root.tables("lights");
        root.refuse_unknown_keys();
        const Error error = problems.as_error().value();
        EXPECT_EQ(error.what, what);
        EXPECT_EQ(error.cure, cure);
    }
}

TEST(TomlFields, several_problems_are_told_line_by_line_each_with_its_cure) {
    TomlProblems problems;
    auto root = TomlTable::parse_text("flag = 1\nfoo = 1\n", "a.toml", problems);
    bool flag = false;
    root.boolean("flag", flag);
    root.refuse_unknown_keys();
    EXPECT_EQ(problems.as_error().value().message(),
              "a.toml:2: foo: is not a known key: remove it\n"
              "a.toml:1: flag: is neither true nor false: write true or false, without quotes");
}

TEST(TomlFields, a_missing_file_is_not_found) {
    TomlProblems problems;
    (void)TomlTable::parse_file("/none/a.toml", problems);
    EXPECT_EQ(problems.as_error().value().code, ErrorCode::not_found);
}

TEST(TomlFields, a_missing_file_and_a_syntax_error_are_problems) {
    TomlProblems problems;
    auto missing = TomlTable::parse_file("/nonexistent/file.toml", problems);
    auto broken = TomlTable::parse_text("a = \n", "b.toml", problems);
    auto folder = TomlTable::parse_file("/", problems);
    EXPECT_THAT(problems.lines(),
                ElementsAre("/nonexistent/file.toml: cannot be read (No such file or directory): check that the file "
                            "exists and may be read",
                            HasSubstr("b.toml:1: not valid TOML"),
                            "/: cannot be read (Is a directory): give a file of this folder"));
}

}  // namespace
}  // namespace hord::common
