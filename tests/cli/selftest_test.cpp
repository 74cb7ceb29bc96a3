// `hordctl selftest` on devices: the simulated ones, and absent real ones.
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/cli/program.h"

namespace hord::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Selftest, of_the_simulated_cell_has_a_row_for_everything_and_moves_the_ejector_only_when_asked) {
    const Said said = run("hordctl", {"selftest", "--simulate"});
    for (const char* row : {"judgement", "part sensor", "light 0", "sensor", "frame", "rejector"}) EXPECT_THAT(said.out, HasSubstr(row)) << said.err;
    EXPECT_THAT(said.out, AllOf(HasSubstr("HORD coil module 1.0; ejector (coil 0) is 0; run permit (coil 1) is 0"), HasSubstr("not moved: add --actuate")));
    EXPECT_THAT(said.out, HasSubstr("spots of")) << "its frame was judged";
    EXPECT_TRUE(said.status == 0 || said.status == 1) << said.err;  // a busy machine misses flashes
    const Said moved = run("hordctl", {"selftest", "--simulate", "--actuate"});
    EXPECT_THAT(moved.out, Not(HasSubstr("not moved")));
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
    EXPECT_THAT(said.out, AllOf(HasSubstr("/dev/no-such-video"), HasSubstr("no-such-chip"), HasSubstr("/dev/no-such-line"), HasSubstr("4 of 5 rows are bad")));
    std::size_t cures = 0;
    for (auto at = said.out.find("cure: "); at != std::string::npos; at = said.out.find("cure: ", at + 1)) ++cures;
    EXPECT_EQ(cures, 4U) << said.out;
}

TEST(Selftest, refuses_what_does_not_go_together) {
    EXPECT_EQ(run("hordctl", {"selftest", "--actuate"}).status, 2);
    EXPECT_EQ(run("hordctl", {"selftest", "--simulate", "--modbus", "127.0.0.1:1502"}).status, 2);
    EXPECT_EQ(run("hordctl", {"selftest", "--config", "/no/such.toml"}).status, 2);
}

}  // namespace
}  // namespace hord::test
