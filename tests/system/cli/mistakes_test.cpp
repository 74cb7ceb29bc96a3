// What the programs say of mistakes on the command line, of blank files and of output that cannot be written.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;

TEST(Mistakes, output_that_does_not_reach_its_disk_is_an_error) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << simulated_beside("");
    const std::string check = "hordd --check --config " + (folder / "c.toml");
    const char* const commands[] = {"hordctl registers", "hordctl registers --format json",
                                    "hordctl --help",    "hord-lab --version",
                                    "hordd --catalog",   check.c_str()};
    // Of a pipe: nobody reads it any more, and its reader's end is no end of this program, as under a service manager.
    const std::pair<std::string, std::string> places[] = {
        {" >/dev/full", " (No space left on device): see that its disk has space\n"},
        {" | sleep 0", " (Broken pipe): let its reader read to the end\n"},
        {" >&-", " (Bad file descriptor): start it with a stdout that can be written: a file, a pipe or a terminal\n"}};
    for (const char* command : commands) {
        for (const auto& [place, why] : places) {
            const Said said =
                run("/bin/bash",
                    {"-c", "set -o pipefail; trap '' PIPE; { sleep 0.2; \"$0\"/" + std::string(command) + "; }" + place,
                     HORD_BIN_DIR});
            EXPECT_EQ(said.status, 2) << command << place << said.err;
            EXPECT_THAT(said.err, HasSubstr("the output could not be written" + why)) << command << place;
            EXPECT_EQ(std::ranges::count(said.err, '\n'), 1) << command << place << ": told once\n" << said.err;
        }
    }
}

TEST(Mistakes, a_blank_file_is_refused_and_named) {
    const TemporaryFolder folder;
    std::ofstream(folder / "good.toml") << simulated_beside("[inspection]\nrecipe = \"blank.toml\"\n");
    const std::string blank = folder / "blank.toml";
    for (const char* text : {"", " \n\n"}) {
        std::ofstream(blank) << text;
        for (const auto& [program, arguments] : std::vector<std::pair<std::string, std::vector<std::string>>>{
                 {"hordd", {"--check", "--config", blank}},
                 {"hordd", {"--check", "--config", folder / "good.toml"}},
                 {"hord-safe", {"--config", blank}},
                 {"hord-page", {"--check", "--config", blank}},
                 {"hord-mqtt", {"--check", "--config", blank}},
                 {"hordctl", {"recipe", "check", blank}},
                 {"hordctl", {"recipe", "seal", blank}},
                 {"hord-lab", {"render", blank, "--out", folder / "o.png"}}}) {
            const Said said = run(program, arguments);
            EXPECT_TRUE(said.status == 2 || said.status == 78) << program << " " << said.status;
            EXPECT_THAT(said.err, HasSubstr("blank.toml: is empty: write it again, or remove it")) << program;
        }
    }
}

TEST(Mistakes, a_configuration_that_may_have_lost_its_end_is_used_and_named) {
    const TemporaryFolder folder;
    const std::string file = folder / "cut.toml";
    for (const auto& [program, section] : std::vector<std::pair<std::string, std::string>>{
             {"hord-page", "[page]\nviewers = 1"}, {"hord-mqtt", "[broker]\nport = 1"}}) {
        for (const bool cut : {true, false}) {
            std::ofstream(file) << section << (cut ? "" : "\n");
            const Said said = run(program, {"--check", "--config", file});
            EXPECT_EQ(said.status, 0) << program;
            EXPECT_EQ(said.err,
                      cut ? program + ": " + file +
                              ":2: the last line has no line end, so the file may have lost its end, and defaults "
                              "count for what is lost: compare it with its original, and end it with a line end\n"
                          : "");
        }
    }
}

TEST(Mistakes, on_the_command_line_are_named) {
    const auto refused = [](const std::vector<std::string>& arguments, const std::string& what) {
        const Said said = run("hordctl", arguments);
        EXPECT_EQ(said.status, 2) << what;
        EXPECT_THAT(said.err, HasSubstr(what));
        EXPECT_LT(said.err.size(), 700U) << "one line, without limits of 300 digits";
        EXPECT_EQ(std::ranges::count(said.err, '\n'), 1) << said.err;
    };
    refused({"recipe", "chek"}, "\"chek\" is not known: did you mean check? See hordctl recipe --help");
    refused({"inspekt", "none.png"}, "\"inspekt\" is not known: did you mean inspect? See hordctl --help");
    refused({"wobble"}, "\"wobble\" is not known: see hordctl --help");
    refused({"inspect", "--macroo", "9x9", "none.png"},
            "\"--macroo\" is not known: did you mean --macro? See hordctl inspect --help");
    refused({"inspect", "--jsn=1", "none.png"}, "\"--jsn\" is not known: did you mean --json?");
    refused({"inspect"}, "see hordctl inspect --help");
    refused({"selftest", "now"}, "\"now\" is one argument too many: see hordctl selftest --help");
    refused({}, "no command is given: see hordctl --help");
    refused({"recipe"}, "no command is given: see hordctl recipe --help");
    refused({"devices", "--module", "host:seven"}, "--module host:seven is no address");
    refused({"devices", "--module", ""}, "--module: name the module: HOST[:PORT]");
    refused({"devices", "--unit", "5"}, "--unit has no effect without --module: see hordctl devices --help");
    refused({"devices", "--root", "/no/such/folder"}, "--root: /no/such/folder is no folder: see");
    refused({"replay", "--today", "--recipe", "r.toml"}, "--recipe cannot be given together with --today: see");
    refused({"inspect", "--macro"}, "hordctl: --macro needs a value: see hordctl inspect --help");
    refused({"results", "--last"}, "hordctl: --last needs a number: see hordctl results --help");
    refused({"registers", "--format"}, "--format needs a value: one of md, csv, json, st, telegraf: see");
    refused({"inspect", "a.png", "--macro", "9x9", "--macro", "7x7"}, "--macro is given 2 times: give it once: see");
    refused({"inspect", "a.png", "--json=maybe"}, "--json takes no value: leave \"=maybe\" out: see");
    refused({"run", "--parts", "99999999999999999999"}, "--parts: 99999999999999999999 is out of range: see");
    refused({"devices", "--modbus", "192.168.1.30"}, "to ask a Modbus module, give --module HOST[:PORT]");
    refused({"run", "--simulate", "--seed", "010"}, "010 begins with 0");
    refused({"latency", "--simulate", "--edges", "010"}, "010 begins with 0");
    refused({"inspect", "none.png", "--macro", "4294967305x9"}, "--macro 4294967305x9 is not a macro-pixel size");
    refused({"results", "--last", "0"}, "--last: 0 is not above 0");
    refused({"results", "--run", "0"}, "--run: 0 is not above 0");
    refused({"results", "changes", "--run", "-5"}, "--run: -5 is not above 0");
    refused({"results", "--reason", "verdict-lat"}, "no reason is called \"verdict-lat\"");
    refused({"tune", "--good", "a", "--bad", "b", "--budget", "-1"}, "--budget: -1 is not above 0");
    refused({"watch", "--count", "-1"}, "--count");
    refused({"reset"}, "reset is a command of the station: call hordctl command reset");
    refused({"start"}, "call hordctl command start_single or start_continuous");
    refused({"use_recipe", "7"}, "call hordctl recipe use NUMBER");
    refused({"status", "--timeout", "abc"}, "--timeout: \"abc\" is no number: give 1 to 60000: see hordctl status");
    refused({"run", "--rate", "5e9"}, "--rate: 5e9 is not in the range 0.1 to 1000");
    refused({"learn", "a.png", "--out", "o", "--read-dn", "nan"}, "--read-dn: nan is no");
    refused({"--modbus", "127.0.0.1:1", "status"},
            "\"--modbus\" stands before the command that it belongs to: write it behind: see hordctl status --help");
    refused({"inspect", "a.png", "--bits", "8.0"}, "--bits: \"8.0\" is no whole number");
    refused({"inspect", "a.png", "--bits", "7"}, "--bits: 7 is not in the range 8 to 16");
    refused({"recipe", "list", "nope"}, "nope: No such file or directory: give the folder that the recipes are in");
    refused({"run", "--simulate", "--parts", "1", "--vitals", "/nope/x.csv"}, "the folder /nope does not exist");
    refused({"calibrate", "none.png", "--out", "nope/g.toml"}, "the folder nope does not exist: create it first");
    refused({"calibrate", "none.png", "--out", "/"}, "--out / is a folder: give the name of a file");
    refused({"command", "use_recipe"}, "call hordctl recipe use NUMBER");
    refused({"command", "teach"}, "call hordctl teach");
    refused({"run", "--simulate", "--foo"}, "\"--foo\" is not known: see hordctl run --help");
}

TEST(Mistakes, a_folder_that_may_not_be_written_is_not_told_to_be_missing) {
    if (::geteuid() == 0 && !std::filesystem::exists("/usr/bin/setpriv"))
        GTEST_SKIP() << "needs setpriv, to be a user without rights";
    const TemporaryFolder folder;
    std::filesystem::permissions(folder.path(), std::filesystem::perms(0555));
    const std::string program = std::string(HORD_BIN_DIR) + "/hordctl", out = folder / "x.hordref";
    std::vector<std::string> words{"learn", "none.png", "--out", out};
    if (::geteuid() == 0) words.insert(words.begin(), {"--reuid=65534", "--regid=65534", "--clear-groups", program});
    const Said said = run(::geteuid() == 0 ? "/usr/bin/setpriv" : program, words);
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("--out " + out + " cannot be written (Permission denied)"));
    std::filesystem::permissions(folder.path(), std::filesystem::perms(0755));
}

TEST(Mistakes, a_store_that_is_a_file_of_another_kind_is_refused_by_the_page) {
    const TemporaryFolder folder;
    std::ofstream(folder / "station.toml") << simulated_beside("");
    const Said said = run("hord-page", {"--check", "--store", folder / "station.toml"});
    EXPECT_EQ(said.status, 78);
    EXPECT_THAT(said.err, HasSubstr("station.toml is no folder of a store: name the folder that holds results.db"));
}

TEST(Mistakes, an_empty_argument_is_not_an_option_that_is_not_given) {
    for (const char* command :
         {"hordctl inspect a.png --recipe ''", "hordctl inspect a.png --reference ''",
          "hordctl inspect a.png --grid ''", "hordctl inspect a.png --out ''", "hordctl inspect a.png --feature ''",
          "hordctl inspect a.png --macro ''", "hordctl inspect --recipe= a.png", "hordctl run --parts 1 --config ''",
          "hordctl selftest --config ''", "hordctl results --recipe ''", "hord-page --listen ''",
          "hord-page --modbus ''", "hord-mqtt --config ''", "hordd --check --config ''", "hord-safe --config ''",
          "hord-lab render s.toml --out ''", "hordctl inspect ''"}) {
        const Said said = run("/bin/sh", {"-c", "\"$0\"/" + std::string(command), HORD_BIN_DIR});
        EXPECT_EQ(said.status, 2) << command;
        EXPECT_THAT(said.err, HasSubstr(" is empty: is a variable of the script not set?")) << command;
        EXPECT_EQ(std::ranges::count(said.err, '\n'), 1) << said.err;
    }
    EXPECT_THAT(run("hordctl", {"inspect", "--recipe=", "a.png"}).err,
                HasSubstr("hordctl: --recipe is empty: is a variable of the script not set? See hordctl"));
}

TEST(Mistakes, an_output_overwrites_no_input_and_no_other_output) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder.path() / "a");
    std::filesystem::create_directories(folder.path() / "b");
    std::filesystem::create_directories(folder.path() / "store/frames");
    for (const char* name : {"a/lens.png", "a/lens.emd.png", "b/lens.png", "a/lens.emd.tiff", "store/results.db",
                             "store/frames/1.png", "r.toml", "vit.toml", "s.toml", "1.jsonl"})
        std::ofstream(folder / name) << "kept";
    std::filesystem::create_hard_link(folder / "a/lens.png", folder / "link.png");
    const auto refused = [&](const std::string& program, const std::vector<std::string>& arguments,
                             const std::string& what) {
        const Said said = run(program, arguments);
        EXPECT_EQ(said.status, 2) << what;
        EXPECT_THAT(said.err, HasSubstr(what)) << arguments[0];
    };
    const std::string lens = folder / "a/lens.png", out = folder / "a", store = folder / "store",
                      scene = folder / "s.toml", read = " is one of the files that are read: it is not overwritten";
    refused("hordctl", {"replay", "--store", store, "--out", store + "/results.db"}, "results.db" + read);
    refused("hordctl", {"replay", store + "/frames/1.png", "--out", store + "/results.db"}, "results.db" + read);
    refused("hordctl", {"replay", lens, "--out", folder / "link.png"}, "link.png" + read);
    refused("hordctl", {"merge", folder / "1.jsonl", "--out", folder / "a/../1.jsonl"}, "1.jsonl" + read);
    refused("hordctl", {"import", lens, "--out", lens}, "lens.png" + read);
    refused("hordctl", {"import", lens, "--out", folder / "i.jpg"},
            "i.jpg does not end in .png, which is what is written");
    refused("hordctl", {"run", "--config", folder / "vit.toml", "--vitals", folder / "vit.toml"}, "vit.toml" + read);
    refused("hordctl", {"inspect", lens, folder / "a/lens.emd.png", "--out", out, "--feature", "emd"},
            "lens.emd.png" + read);
    refused("hordctl", {"export", lens, folder / "a/lens.emd.tiff", "--out", out, "--format", "tiff"},
            "lens.emd.tiff" + read);
    refused("hordctl", {"export", lens, folder / "b/lens.png", "--out", folder / "o"},
            "two frames named lens would overwrite each other");
    refused("hordctl", {"calibrate", lens, "--out", folder / "g.toml", "--centres", lens}, "lens.png" + read);
    refused("hord-lab", {"render", scene, "--out", folder / "x.png", "--truth", scene}, "--truth " + scene + read);
    refused("hord-lab", {"render", scene, "--out", folder / "x.png", "--truth", folder / "./x.png"},
            "x.png is written by --out, too: give each a file of its own");
    for (const char* name :
         {"a/lens.png", "a/lens.emd.png", "a/lens.emd.tiff", "store/results.db", "vit.toml", "s.toml"})
        EXPECT_EQ(std::filesystem::file_size(folder / name), 4U) << name;
}

TEST(Mistakes, an_output_overwrites_nothing_that_people_write) {
    const TemporaryFolder folder;
    const std::filesystem::path deploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";
    const std::string frame = folder / "a.png", station = folder / "station.toml", recipe = folder / "lens.toml";
    std::ofstream(frame) << "no image";
    std::filesystem::copy(deploy / "hordd.toml", station);
    std::filesystem::copy(deploy / "recipes/default.toml", recipe);
    const auto before = std::filesystem::file_size(station);
    const std::vector<std::vector<std::string>> commands{
        {"hordctl", "learn", frame, "--out", station},
        {"hordctl", "replay", frame, "--out", station},
        {"hordctl", "merge", folder / "1.jsonl", "--out", station},
        {"hordctl", "calibrate", frame, "--out", station},
        {"hordctl", "calibrate", frame, "--out", folder / "g.toml", "--centres", station},
        {"hordctl", "run", "--simulate", "--parts", "1", "--vitals", station},
        {"hord-lab", "render", folder / "s.toml", "--out", folder / "x.png", "--truth", station}};
    for (const auto& command : commands) {
        const Said said = run(command[0], {command.begin() + 1, command.end()});
        EXPECT_EQ(said.status, 2) << command[1];
        EXPECT_THAT(said.err, HasSubstr("station.toml is a station's configuration: it is not overwritten"))
            << command[1];
    }
    EXPECT_THAT(run("hordctl", {"learn", frame, "--out", recipe}).err, HasSubstr("lens.toml is a recipe"));
    EXPECT_EQ(std::filesystem::file_size(station), before);
}

TEST(Mistakes, a_file_of_another_kind_is_called_what_it_is) {
    const std::filesystem::path deploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";
    const std::string station = deploy / "hordd.toml", page = deploy / "page.toml", mqtt = deploy / "mqtt.toml",
                      recipe = deploy / "recipes/default.toml";
    const TemporaryFolder folder;
    const std::string reference = folder / "lens.hordref", image = folder / "a.png";
    std::ofstream(reference) << "HORDREF2 and more";
    std::ofstream(image) << "\x89PNG\r\n\x1a\n";
    const auto refused = [](const std::string& program, const std::vector<std::string>& arguments,
                            const std::string& what) {
        const Said said = run(program, arguments);
        EXPECT_TRUE(said.status == 2 || said.status == 78) << program << said.status;
        EXPECT_THAT(said.err, HasSubstr(what));
        EXPECT_EQ(std::ranges::count(said.err, '\n'), 1) << said.err;
    };
    refused("hordctl", {"inspect", reference}, "lens.hordref is a learned reference, and an image is needed");
    refused("hordctl", {"calibrate", reference, "--out", folder / "g.toml"}, "is a learned reference");
    refused("hordctl", {"inspect", station}, "hordd.toml is a station's configuration, and an image is needed");
    refused("hordctl", {"inspect", image, "--recipe", reference}, "is a learned reference, and a recipe is needed");
    refused("hordctl", {"inspect", image, "--recipe", image}, "is an image, and a recipe is needed");
    refused("hordctl", {"inspect", image, "--grid", recipe}, "is a recipe, and a calibration is needed");
    refused("hordctl", {"recipe", "check", station}, "is a station's configuration, and a recipe is needed");
    refused("hordctl", {"recipe", "seal", page}, "is the page's configuration, and a recipe is needed");
    refused("hord-page", {"--check", "--config", station}, "is a station's configuration, and the page's");
    refused("hord-mqtt", {"--check", "--config", station},
            "is a station's configuration, and a configuration of hord-");
    refused("hordd", {"--check", "--config", page}, "is the page's configuration, and a station's");
    refused("hordd", {"--check", "--config", mqtt}, "is a configuration of hord-mqtt, and a station's");
    refused("hordd", {"--check", "--config", recipe}, "is a recipe, and a station's configuration is needed");
    const std::string scene = std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes/lens.toml",
                      out = folder / "o.png";
    for (const auto& [program, arguments] : std::vector<std::pair<std::string, std::vector<std::string>>>{
             {"hordctl", {"recipe", "check", scene}},
             {"hordctl", {"recipe", "seal", scene}},
             {"hordctl", {"inspect", scene}},
             {"hordctl", {"inspect", image, "--recipe", scene}},
             {"hordctl", {"inspect", image, "--grid", scene}},
             {"hordctl", {"run", "--simulate", "--config", scene}},
             {"hordd", {"--check", "--config", scene}},
             {"hord-safe", {"--config", scene}},
             {"hord-page", {"--check", "--config", scene}},
             {"hord-page", {"--stations", scene}},
             {"hord-mqtt", {"--check", "--config", scene}}})
        refused(program, arguments, "lens.toml is a scene of the simulated cell, and ");
    refused("hord-lab", {"render", station, "--out", out},
            "is a station's configuration, and a scene of the simulated");
    refused("hord-lab", {"render", recipe, "--out", out},
            "a scene of the simulated cell is needed: give it to hordctl");
    refused("hord-page", {"--stations", station}, "is a station's configuration, and a list of stations is needed");
}

TEST(Mistakes, a_macro_pixel_that_does_not_divide_the_frame_names_those_that_do) {
    const TemporaryFolder folder;
    std::ofstream(folder / "a.pgm", std::ios::binary) << "P5\n90 63\n255\n" << std::string(90 * 63, '\x40');
    const Said said = run("hordctl", {"inspect", folder / "a.pgm", "--macro", "7x7"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("it can be divided into 3x3, 9x9 bins a lenslet: give --macro"));
    std::ofstream(folder / "b.pgm", std::ios::binary) << "P5\n97 63\n255\n" << std::string(97 * 63, '\x40');
    EXPECT_THAT(run("hordctl", {"inspect", folder / "b.pgm"}).err, HasSubstr("no square macro-pixel of 3 to 15 bins"));
}

TEST(Mistakes, a_name_that_is_empty_or_not_one_line_is_refused) {
    const TemporaryFolder folder;
    for (const auto& [name, what] : {std::pair("\"\"", "name: is empty"),
                                     {"\"a\\nb\"", "name: holds a control character"},
                                     {"\"a\\u007f\"", "name: holds a control character"}}) {
        std::ofstream(folder / "r.toml") << "schema = 1\nname = " << name << '\n';
        std::ofstream(folder / "c.toml") << simulated_beside(std::string("[station]\nname = ") + name + '\n');
        const Said recipe = run("hordctl", {"recipe", "check", folder / "r.toml"});
        EXPECT_EQ(recipe.status, 2);
        EXPECT_THAT(recipe.err, HasSubstr(what));
        const Said station = run("hordd", {"--check", "--config", folder / "c.toml"});
        EXPECT_EQ(station.status, 78);
        EXPECT_THAT(station.err, HasSubstr(what));
    }
}

TEST(Mistakes, a_dark_frame_as_bright_as_the_white_one_is_named) {
    const TemporaryFolder folder;
    const std::string white = folder / "w.pgm";
    std::ofstream(white, std::ios::binary) << "P5\n90 63\n255\n" << std::string(90 * 63, '\x40');
    EXPECT_THAT(run("hordctl", {"calibrate", white, "--dark", white, "--out", folder / "g.toml"}).err,
                HasSubstr("the dark frame is as bright as the white one: record it without light"));
}

TEST(Mistakes, two_recipes_of_a_folder_with_one_number_are_told) {
    const TemporaryFolder folder;
    std::filesystem::create_directories(folder.path() / "recipes");
    const std::string a = folder / "recipes/a.toml", b = folder / "recipes/b.toml";
    std::ofstream(a) << "schema = 1\nname = \"a\"\nnumber = 7\n";
    std::ofstream(b) << "schema = 1\nname = \"b\"\nnumber = 8\n";
    std::ofstream(folder / "c.toml") << simulated_beside("[inspection]\nrecipes = \"recipes\"\n");
    EXPECT_EQ(run("hordctl", {"recipe", "check", a, b, a}).status, 0) << "the same file twice is one recipe";
    EXPECT_EQ(run("hordd", {"--check", "--config", folder / "c.toml"}).status, 0);
    std::ofstream(b) << "schema = 1\nname = \"b\"\nnumber = 7\n";
    const std::string doubled = "both have number 7: give each recipe a number of its own";
    const Said said = run("hordctl", {"recipe", "check", a, b});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr(doubled));
    // The line runs with it, so --check says what a start says.
    for (const std::string name : {"c", "d"})
        std::ofstream(folder / ("recipes/" + name + ".toml"))
            << "schema = 1\nnumber = 9\n[reference]\nfile = \"gone\"\n";
    const Said told = run("hordd", {"--check", "--config", folder / "c.toml"});
    EXPECT_EQ(told.status, 0) << told.err;
    EXPECT_THAT(told.out, HasSubstr("note: " + a + " and " + b + " both have number 7, "));
    for (const std::string name : {"c", "d"})
        EXPECT_THAT(told.out, HasSubstr("cannot be selected: " + (folder / ("recipes/" + name + ".toml:4"))));
}

// On a terminal of 60 columns no line of a help is longer; a pasted example is still one command.
TEST(Help, fits_the_terminal) {
    const auto on_terminal = [](const std::string& command) {
        return run("/usr/bin/script",
                   {"-qefc", "stty cols 60 rows 24; \"" + std::string(HORD_BIN_DIR) + "\"/" + command, "/dev/null"});
    };
    for (const char* command : {"hordctl inspect --help", "hordctl --help", "hord-page --help", "hordd --help"}) {
        const Said said = on_terminal(command);
        std::istringstream lines(said.out);
        std::size_t longest = 0;
        for (std::string line; std::getline(lines, line);) {
            while (line.ends_with('\r')) line.pop_back();
            if (!line.starts_with("Usage:")) longest = std::max(longest, line.size());
        }
        EXPECT_GT(longest, 40U) << said.out;
        EXPECT_LE(longest, 60U) << said.out;
    }
    EXPECT_THAT(on_terminal("hordctl inspect --help").out, HasSubstr(" \\\r\n"));
    EXPECT_THAT(run("hordctl", {"inspect", "--help"}).out, HasSubstr("FRAME TEXT ... REQUIRED     Frames"))
        << "elsewhere nothing is wrapped: the shell's completion reads it";
}

TEST(Help, of_every_program_is_completed_by_the_shell) {
    const auto completed = [](const std::string& line, int word) {
        return run("/bin/bash",
                   {"-c",
                    ". " HORD_SOURCE_DIR "/deploy/hordctl.bash; read -ra COMP_WORDS <<<\"$0\"; COMP_CWORD=$1; "
                    "$(complete -p \"${COMP_WORDS[0]##*/}\" | sed 's/.*-F \\([^ ]*\\).*/\\1/'); echo "
                    "\"${COMPREPLY[*]}\"",
                    HORD_BIN_DIR "/" + line, std::to_string(word)})
            .out;
    };
    for (const char* program : {"hordctl", "hord-lab", "hordd", "hord-mqtt", "hord-page", "hord-safe"})
        EXPECT_EQ(completed(std::string(program) + " --he", 1), "--help\n") << program;
    EXPECT_EQ(completed("hordctl rec", 1), "recipe\n");
    EXPECT_EQ(completed("hordctl command dis", 2), "disarm\n");
    EXPECT_EQ(completed("hordd --ch", 1), "--check\n");
}

TEST(Help, of_every_program_is_a_man_page) {
    const TemporaryFolder folder;
    const Said made = run(HORD_SOURCE_DIR "/deploy/package/man.sh", {HORD_BIN_DIR, folder / "man", "1.2.3"});
    ASSERT_EQ(made.status, 0) << made.err;
    for (const char* page : {"man1/hordctl.1", "man1/hord-lab.1", "man8/hordd.8", "man8/hord-mqtt.8",
                             "man8/hord-page.8", "man8/hord-safe.8", "man8/hord-camera.8", "man8/hord-genicam.8"}) {
        const Said text = run("/bin/zcat", {folder / ("man/" + std::string(page) + ".gz")});
        EXPECT_THAT(text.out, HasSubstr(".SH DESCRIPTION")) << page;
        EXPECT_GT(text.out.size(), 400U) << page;
    }
    EXPECT_THAT(run("/bin/zcat", {folder / "man/man1/hordctl.1.gz"}).out, HasSubstr("RECIPE SEAL"));
}

}  // namespace
}  // namespace hord::test
