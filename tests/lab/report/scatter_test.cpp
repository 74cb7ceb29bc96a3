// Marks and legend of scatter plots.
#include "lab/report/scatter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::lab {
namespace {

using ::testing::HasSubstr;

std::string script_of(double low, double high) {
    Scatter scatter({low, high, true}, {0, 1, false});
    scatter.add(low * 1.05, 0.5, "one", 0);
    return scatter.script();
}

TEST(Scatter, a_logarithmic_axis_has_three_marks_at_round_numbers_however_narrow_it_is) {
    EXPECT_THAT(script_of(0.11, 160), HasSubstr("set xtics (\"1\" 1, \"10\" 10, \"100\" 100)\n"));
    EXPECT_THAT(script_of(0.8, 6), HasSubstr("set xtics (\"1\" 1, \"2\" 2, \"5\" 5)\n"));
    EXPECT_THAT(script_of(0.106, 0.45), HasSubstr("set xtics (\"0.2\" 0.2, \"0.3\" 0.3, "));
    EXPECT_THAT(script_of(0.15, 0.18), HasSubstr("set xtics (\"0.15\" 0.15, \"0.16\" 0.16, \"0.17\" 0.17"));
}

TEST(Scatter, the_legend_lies_below_the_plot) {
    const std::string script = script_of(1, 100);
    EXPECT_THAT(script, HasSubstr("set bmargin at screen 0.19\n"));
    EXPECT_THAT(script, HasSubstr("set key at screen 0.53,0.015 bottom center"));
}

}  // namespace
}  // namespace hord::lab
