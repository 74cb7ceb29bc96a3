// The cases of `hordctl experiment stability`, as tests; the full number of degenerate pairs is left to the experiment.
#include "firmware/experiment/stability.h"

#include <cmath>

#include <gtest/gtest.h>

#include "firmware/experiment/transport_check.h"

namespace hord::firmware {
namespace {

const StabilityTable& every_case() {
    static const StabilityTable table = check_stability({.degenerate_pairs = 20'000, .random_pairs = 500});
    return table;
}

class Stability : public ::testing::TestWithParam<const char*> {};

TEST_P(Stability, keeps_every_promise) {
    std::size_t cases = 0;
    for (const StabilityRow& row : every_case().rows()) {
        if (row.group != GetParam()) continue;
        ++cases;
        EXPECT_TRUE(row.good) << row.name << ": expected " << row.expected << ", got " << row.got;
    }
    EXPECT_GT(cases, 0U) << "nothing is checked";
}

const char* const kExtremes[] = {"all zero", "one photon", "one bin", "all saturated", "one lenslet row", "disjoint supports", "equal histograms",
                                 "1 DN differences at 16 bit", "sums at the type's limit", "masses differing by 1", "collinear supports",
                                 "degenerate transport ties", "direction maps", "singular, zero, huge, nearly rank-one Jacobians", "dark neighbours",
                                 "pedestals", "invariance to exposure, transposition, mirroring", "identity, symmetry, triangle, bounds",
                                 "no NaN, no infinity, whatever the frame", "entropic cross-check (Sinkhorn, log domain)"};
INSTANTIATE_TEST_SUITE_P(at, Stability, ::testing::ValuesIn(kExtremes), [](const auto& at) {
    std::string name;
    for (const char c : std::string(at.param)) name += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
    return name;
});

TEST(StabilityTable, calls_wrong_what_is_wrong) {
    StabilityTable table;
    table.begin("x");
    table.near("right", 1, 1.05, 0.1);
    table.at_most("right", 2, 2);
    table.same("right", 3, 3);
    EXPECT_EQ(table.wrong(), 0U);
    table.near("too far", 1, 1.2, 0.1);
    table.near("no number", 1, std::nan(""), 0.1);
    table.near("infinite", 1, INFINITY, INFINITY);
    table.at_most("too much", 2, 2.1);
    table.at_most("no number", 2, std::nan(""));
    table.same("another", 3, 4);
    EXPECT_EQ(table.wrong(), 6U);
    EXPECT_NE(as_text(table).find("9 cases, 6 wrong"), std::string::npos);
    EXPECT_NE(as_csv(table).find("\"x\",\"another\",\"3\",\"4\",WRONG"), std::string::npos);
}

// The checkers themselves, by hand: three stay, two move from (1,0) to (2,2).
TEST(TransportCheck, is_what_a_hand_computes) {
    const Masses a{1, 2, 0, 0, 1, 1, 0, 0, 0}, b{1, 0, 0, 0, 1, 1, 0, 0, 2};
    EXPECT_NEAR(distance_by_shortest_paths(a, b, *algo::GroundDistance::between_bins(3, 3)), 2 * std::sqrt(5.0) / 5, 1e-14);
    EXPECT_NEAR(distance_by_shortest_paths(a, b, *algo::GroundDistance::between_bins(3, 3, algo::GroundNorm::manhattan)), 6.0 / 5, 1e-14);
    const Sinkhorn s = sinkhorn(a, b, *algo::GroundDistance::between_bins(3, 3), 0.05, 1e-5, 100'000);
    EXPECT_LE(s.residual, 1e-5);
    EXPECT_NEAR(s.cost, 2 * std::sqrt(5.0) / 5, s.bias + 1e-4);
    EXPECT_LT(s.bias, 0.15);
}

}  // namespace
}  // namespace hord::firmware
