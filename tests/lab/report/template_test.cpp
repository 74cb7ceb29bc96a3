#include "lab/report/template.h"

#include <gtest/gtest.h>

namespace hord::lab {
namespace {

TEST(Template, a_field_takes_the_place_of_its_tag) {
    EXPECT_EQ(fill_template("seed {{seed}}, {{seed}}.\n", {{"seed", "7"}}), "seed 7, 7.\n");
}

TEST(Template, a_section_appears_only_with_its_field) {
    const std::string text = "a{{#quick}}, quick{{/quick}}{{^quick}}, full{{/quick}}\n";
    EXPECT_EQ(fill_template(text, {{"quick", "yes"}}), "a, quick\n");
    EXPECT_EQ(fill_template(text, {{"quick", ""}}), "a, full\n");
}

TEST(Template, sections_nest) {
    const std::string text = "{{#a}}a{{#b}}b{{/b}}c{{/a}}d";
    EXPECT_EQ(fill_template(text, {{"a", "1"}, {"b", ""}}), "acd");
    EXPECT_EQ(fill_template(text, {{"a", ""}, {"b", "1"}}), "d");
}

TEST(Template, a_section_tag_alone_on_its_line_leaves_no_line) {
    EXPECT_EQ(fill_template("a\n{{#b}}\n- b\n{{/b}}\nc\n", {{"b", "1"}}), "a\n- b\nc\n");
    EXPECT_EQ(fill_template("a\n{{#b}}\n- b\n{{/b}}\nc\n", {{"b", ""}}), "a\nc\n");
}

TEST(Template, a_table_alone_on_its_line_ends_that_line) {
    EXPECT_EQ(fill_template("{{table}}\n\nafter\n", {{"table", "| a |\n"}}), "| a |\n\nafter\n");
    EXPECT_EQ(fill_template("{{table}}\n\nafter\n", {{"table", "none"}}), "none\n\nafter\n");
}

TEST(Template, a_missing_field_can_be_seen) {
    EXPECT_EQ(fill_template("a {{b}} c {{#d}}e{{/d}}\n", {}), "a {{b}} c {{#d}}e\n");
}

TEST(Template, what_a_field_contains_is_not_read_as_a_tag) {
    EXPECT_EQ(fill_template("{{a}}", {{"a", "{{b}}"}, {"b", "1"}}), "{{b}}");
}

TEST(Template, the_program_has_the_templates_of_the_reports) {
    for (const char* name : {"detection", "tradeoff", "ablation", "kinds", "paper", "tune"})
        EXPECT_NE(fill_report(name, {}), "") << name;
    EXPECT_EQ(fill_report("poem", {}), "");
}

}  // namespace
}  // namespace hord::lab
