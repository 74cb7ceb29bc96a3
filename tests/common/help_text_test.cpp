// Help and pages on a terminal that is narrower than their lines.
#include "common/cli/help_text.h"

#include <gtest/gtest.h>

#include "common/cli/message.h"

namespace hord {
namespace {

TEST(Message, has_the_programs_name_on_each_of_its_lines) {
    EXPECT_EQ(named_lines("hordd", "a.toml:1: one"), "hordd: a.toml:1: one");
    EXPECT_EQ(named_lines("hordd", "a.toml:1: one\na.toml:2: two"), "hordd: a.toml:1: one\nhordd: a.toml:2: two");
    EXPECT_EQ(named_lines("hordd", ""), "hordd: ");
}

TEST(HelpText, of_lines_that_fit_and_of_no_terminal_is_unchanged) {
    const std::string text = "Options:\n  --json       One object\n\nEnd";
    EXPECT_EQ(wrapped(text, 60), text);
    EXPECT_EQ(wrapped(text, 0), text);
    EXPECT_EQ(wrapped(text + '\n', 60), text + '\n');
}

TEST(HelpText, goes_on_below_an_options_description) {
    EXPECT_EQ(wrapped("  --json TEXT   Print one object a line of output", 36),
              "  --json TEXT   Print one object a\n"
              "                line of output");
}

TEST(HelpText, goes_on_below_the_first_word_where_there_is_no_second_column) {
    EXPECT_EQ(wrapped("  one two three four five six seven", 20), "  one two three four\n    five six seven");
}

TEST(HelpText, of_an_example_can_still_be_pasted) {
    EXPECT_EQ(wrapped("Example: hordctl inspect a.png --macro 9x9\n         hordctl inspect b.png --macro 9x9\n", 32),
              "Example: hordctl inspect a.png \\\n"
              "    --macro 9x9\n"
              "         hordctl inspect b.png \\\n"
              "             --macro 9x9\n");
}

TEST(HelpText, leaves_a_word_whole_that_is_longer_than_the_line) {
    EXPECT_EQ(wrapped("see /a/path/that/is/longer/than/the/line now", 20),
              "see\n  /a/path/that/is/longer/than/the/line\n  now");
}

TEST(HelpText, counts_characters_not_bytes) { EXPECT_EQ(wrapped("  pass  ██████████", 20), "  pass  ██████████"); }

}  // namespace
}  // namespace hord
