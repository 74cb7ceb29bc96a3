// `hordctl selftest` on devices, simulated and absent, and `hordctl latency`.
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(Selftest, of_the_simulated_cell_has_a_row_for_everything_and_leaves_the_ejector_alone) {
    const Said said = run("hordctl", {"selftest", "--simulate"});
    for (const char* row : {"judgement", "part sensor", "light 0", "sensor", "frame", "rejector"})
        EXPECT_THAT(said.out, HasSubstr(row)) << said.err;
    EXPECT_THAT(said.out,
                AllOf(HasSubstr("HORD coil module 1.0; ejector (coil 0) is 0; run permit (coil 1) is 0"),
                      HasSubstr("not moved: add --actuate")));
    EXPECT_THAT(said.out, HasSubstr("spots of")) << "its frame was judged";
    EXPECT_TRUE(said.status == 0 || said.status == 1) << said.err;  // a busy machine misses flashes
}

TEST(Selftest, of_absent_devices_names_each_with_its_cure) {
    const TemporaryFolder folder;
    std::ofstream(folder / "c.toml") << R"([sensor]
backend = "v4l2"
device = "/dev/no-such-video"
[strobe]
backend = "gpio"
[[strobe.channel]]
chip = "no-such-chip"
line = "1"
[part_sensor]
backend = "gpio"
chip = "no-such-chip"
line = "2"
[rejector]
backend = "modbus"
device = "/dev/no-such-line"
)";
    const Said said = run("hordctl", {"selftest", "--config", folder / "c.toml", "--actuate"});
    EXPECT_EQ(said.status, 1) << said.err;
    EXPECT_THAT(said.out,
                AllOf(HasSubstr("/dev/no-such-video"), HasSubstr("no-such-chip"), HasSubstr("/dev/no-such-line"),
                      HasSubstr("4 of 5 rows are bad")));
    std::size_t cures = 0;
    for (auto at = said.out.find("cure: "); at != std::string::npos; at = said.out.find("cure: ", at + 1)) ++cures;
    EXPECT_EQ(cures, 4U) << said.out;
}

// As a start refuses them, with their keys, before a device is opened.
TEST(Selftest, refuses_the_files_that_a_start_refuses) {
    const TemporaryFolder folder;
    std::ofstream(folder / "wide.toml") << "schema = 1\nname = \"wide\"\nnumber = 7\nrim_margin = 60\n";
    std::ofstream(folder / "c.toml") << simulated_beside(
        "[inspection]\nmacro = \"3x3\"\nrecipe = \"wide.toml\"\n[modbus]\nport = 0\n");
    for (const std::vector<std::string>& where : {std::vector<std::string>{}, {"--simulate"}}) {
        std::vector<std::string> arguments{"selftest", "--config", folder / "c.toml"};
        arguments.insert(arguments.end(), where.begin(), where.end());
        const Said said = run("hordctl", arguments);
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err,
                    AllOf(HasSubstr("inspection.recipe: " + (folder / "wide.toml")), HasSubstr("rim_margin 60")));
        EXPECT_EQ(said.out, "");
    }
}

TEST(Selftest, refuses_what_does_not_go_together) {
    EXPECT_EQ(run("hordctl", {"selftest", "--actuate"}).status, 2);
    EXPECT_EQ(run("hordctl", {"selftest", "--simulate", "--modbus", "127.0.0.1:1502"}).status, 2);
    EXPECT_EQ(run("hordctl", {"selftest", "--config", "/no/such.toml"}).status, 2);
}

// The counts are consistent: of 6 edges every second one lights at once, the others as planned; idle and busy. The
// measured times are not asserted.
TEST(Latency, of_this_machine_says_what_it_measured_and_what_it_cannot_see) {
    const Said said = run("hordctl", {"latency", "--simulate", "--edges", "6"});
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out,
                AllOf(HasSubstr("clock source: "), HasSubstr("kernel preemption: "), HasSubstr("policy: "),
                      HasSubstr("cannot see")));
    const auto edges_of = [&](const std::string& series) {
        const auto at = said.out.find(series + ": ");
        int measured = -1, missed = -1;
        if (at == std::string::npos) return -1;
        return std::sscanf(said.out.c_str() + at + series.size(), ": %d measured, %d missed", &measured, &missed) == 2
            ? measured + missed
            : -1;
    };
    for (const std::string load : {"idle", "pipeline busy"}) {
        EXPECT_EQ(edges_of("edge to light, as soon as possible, " + load), 3) << said.out;
        EXPECT_EQ(edges_of("planned light, late by, " + load), 3) << said.out;
        EXPECT_EQ(edges_of("edge to reject command at the module, " + load), 6) << said.out;
        EXPECT_EQ(edges_of("edge to reject command acknowledged and read back, " + load), 6) << said.out;
    }
    EXPECT_THAT(said.out, HasSubstr(" us  #")) << "there is a histogram";
    EXPECT_THAT(said.out, HasSubstr("frames were inspected meanwhile"));
    EXPECT_EQ(run("hordctl", {"latency"}).status, 2);
}

}  // namespace
}  // namespace hord::test
