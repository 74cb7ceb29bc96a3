// Settings of the page: tokens and configuration.
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "tests/firmware/page/small_page.h"

namespace hord::firmware::page::test {
namespace {

using store::test::TempFolder;
using store::test::write_text;
using ::testing::HasSubstr;

// -- tokens

TEST(PageTokens, know_their_owners_and_nobody_else) {
    const auto tokens =
        Tokens::parse("# the night shift\nanna 0123456789abcdef01234567\nben  abcdefghijklmnopqrstuvwxyz # new\n", "t");
    ASSERT_TRUE(tokens) << tokens.error().message();
    EXPECT_EQ(tokens->owner("0123456789abcdef01234567"), "anna");
    EXPECT_EQ(tokens->owner("abcdefghijklmnopqrstuvwxyz"), "ben");
    for (const std::string& wrong :
         {std::string(), std::string("0123456789abcdef0123456"), std::string("0123456789abcdef012345678"),
          std::string("0123456789abcdef01234567\0", 25), std::string(100'000, 'a')}) {
        EXPECT_FALSE(tokens->owner(wrong)) << wrong.size();
    }
    EXPECT_FALSE(Tokens().owner(""));
}

TEST(PageTokens, refuse_what_would_be_guessed_or_mistaken) {
    for (const char* text : {"", "# nobody\n", "anna\n", "anna short\n", "anna 0123456789abcdef01234567 more\n",
                             "a-name-of-more-than-twenty-letters 0123456789abcdef01234567\n",
                             "anna 0123456789abcdef01234567\nanna abcdefghijklmnopqrstuvwxyz\n",
                             "anna 0123456789abcdef01234567\nben 0123456789abcdef01234567\n"}) {
        const auto tokens = Tokens::parse(text, "t");
        ASSERT_FALSE(tokens) << text;
        EXPECT_FALSE(tokens.error().cure.empty());
        EXPECT_THAT(tokens.error().message(),
                    ::testing::Not(HasSubstr("0123456789abcdef")));  // a log must not contain a token
    }
}

TEST(PageTokens, are_not_read_from_a_file_that_others_may_read_or_change) {
    const TempFolder folder;
    const auto file = folder.path() / "tokens";
    write_text(file, "anna 0123456789abcdef01234567\n");
    for (const mode_t bad : {0644U, 0666U, 0660U, 0602U}) {
        ASSERT_EQ(::chmod(file.c_str(), bad), 0);
        const auto tokens = Tokens::load(file);
        ASSERT_FALSE(tokens) << bad;
        EXPECT_EQ(tokens.error().code, ErrorCode::refused);
        EXPECT_THAT(tokens.error().cure, HasSubstr("chmod 0640"));
    }
    for (const mode_t good : {0600U, 0640U, 0400U}) {
        ASSERT_EQ(::chmod(file.c_str(), good), 0);
        EXPECT_TRUE(Tokens::load(file)) << good;
    }
    EXPECT_FALSE(Tokens::load(folder.path()));
    EXPECT_FALSE(Tokens::load(folder.path() / "none"));
}

TEST(PageTokens, are_not_awaited_from_a_pipe) {
    const TempFolder folder;
    const auto pipe = folder.path() / "tokens";
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0640), 0);
    const auto tokens = Tokens::load(pipe);
    ASSERT_FALSE(tokens);
    EXPECT_EQ(tokens.error().message(),
              pipe.string() + " is a pipe, not a regular file: write one line \"NAME TOKEN\" for each person");
}

// -- configuration

TEST(PageConfiguration, the_one_that_is_installed_holds_every_key_at_its_default) {
    const auto installed = load_page_config(std::filesystem::path(HORD_SOURCE_DIR) / "deploy/page.toml");
    ASSERT_TRUE(installed) << installed.error().message();
    const PageConfig defaults;
    EXPECT_EQ(installed->host, defaults.host);
    EXPECT_EQ(installed->port, defaults.port);
    EXPECT_EQ(installed->names, defaults.names);
    EXPECT_EQ(installed->viewers, defaults.viewers);
    EXPECT_EQ(installed->shifts, defaults.shifts);
    EXPECT_EQ(installed->modbus, defaults.modbus);
    EXPECT_EQ(installed->store, defaults.store);
    EXPECT_EQ(installed->poll, defaults.poll);
    EXPECT_TRUE(installed->tokens.empty());
}

TEST(PageConfiguration, every_problem_is_told_at_once_with_its_line) {
    const auto read = parse_page_config(
        "[page]\nport = 70000\nnames = [\"http://wall\"]\n[station]\nmodbus = \"a:b:c\"\npoll_ms = 1\n[actions]\ntoken "
        "= 1\n",
        "/etc/hord/page.toml");
    ASSERT_FALSE(read);
    for (const char* part : {"page.toml:2", "page.toml:3", "page.toml:5", "page.toml:6", "page.toml:8", "mean tokens?"})
        EXPECT_THAT(read.error().what, HasSubstr(part));
}

TEST(PageConfiguration, names_have_no_port_and_addresses_are_possible_ones) {
    const auto names = [](const std::string& name) {
        return parse_page_config("[page]\nnames = [\"" + name + "\"]\n", "page.toml");
    };
    const auto host = [](const std::string& name) {
        return parse_page_config("[page]\nhost = \"" + name + "\"\n", "page.toml");
    };
    for (const char* wrong : {"", "cell3:8070", "1.2.3.4:80", "1.2.3.4.5", "1.2.3.256", "[::1]:80", "[cell3]", "a b"}) {
        EXPECT_FALSE(names(wrong)) << wrong;
        EXPECT_FALSE(host(wrong)) << wrong;
    }
    for (const char* right : {"cell3", "Cell-3.plant.example", "10.0.0.7", "0.0.0.0", "::1", "[fe80::1]"}) {
        EXPECT_TRUE(names(right)) << right;
        EXPECT_TRUE(host(right)) << right;
    }
    EXPECT_EQ(names("::1")->names, std::vector<std::string>{"[::1]"});
}

TEST(PageConfiguration, files_are_found_beside_it) {
    const auto read =
        parse_page_config("[station]\nstore = \"store\"\n[actions]\ntokens = \"/x/t\"\n", "/etc/hord/page.toml");
    ASSERT_TRUE(read);
    EXPECT_EQ(read->store, "/etc/hord/store");
    EXPECT_EQ(read->tokens, "/x/t");
}

TEST(PageConfiguration, shifts_begin_at_times_of_a_day) {
    for (const char* wrong : {"[]", "[\"6:00\"]", "[\"24:00\"]", "[\"06:60\"]", "[\"06.00\"]"}) {
        const auto read = parse_page_config("[page]\nshifts = " + std::string(wrong) + "\n", "page.toml");
        ASSERT_FALSE(read) << wrong;
        EXPECT_THAT(read.error().what, HasSubstr("page.toml:2")) << wrong;
    }
    EXPECT_EQ(parse_page_config("[page]\nshifts = [\"05:30\"]\n", "page.toml")->shifts,
              std::vector<std::string>{"05:30"});
}

}  // namespace
}  // namespace hord::firmware::page::test
