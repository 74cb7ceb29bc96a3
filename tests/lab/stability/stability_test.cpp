// The cases of `hord-lab experiment stability`, as tests; the full number of degenerate pairs is left to the
// experiment.
#include "lab/stability/stability.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <iterator>

#include <gtest/gtest.h>

#include "lab/experiment/transport_check.h"

namespace hord::lab {
namespace {

// Every row is right, and every extreme has rows.
template <class Check>
void expect_right(Check check, std::initializer_list<const char*> extremes) {
    StabilityTable table;
    check(StabilityOptions{.degenerate_pairs = 20'000, .random_pairs = 500}, table);
    for (const StabilityRow& row : table.rows()) {
        EXPECT_TRUE(row.good) << row.group << ": " << row.name << ": expected " << row.expected << ", got " << row.got;
    }
    for (const char* extreme : extremes)
        EXPECT_TRUE(std::ranges::count(table.rows(), std::string(extreme), &StabilityRow::group) > 0) << extreme;
}

TEST(Stability, pairs_of_hords_keep_every_promise) {
    expect_right(
        check_hords,
        {"all zero", "one photon", "one bin", "all saturated", "disjoint supports", "equal histograms",
         "1 DN differences at 16 bit", "sums at the type's limit", "masses differing by 1", "collinear supports",
         "identity, symmetry, triangle, bounds", "invariance to exposure, transposition, mirroring"});
}

TEST(Stability, transport_problems_keep_every_promise) {
    expect_right(check_transport,
                 {"degenerate transport ties", "direction maps", "entropic cross-check (Sinkhorn, log domain)"});
}

TEST(Stability, frames_keep_every_promise) {
    expect_right(check_frames,
                 {"all zero", "one photon", "all saturated", "one lenslet row", "dark neighbours", "pedestals",
                  "invariance to exposure, transposition, mirroring", "singular, zero, huge, nearly rank-one Jacobians",
                  "no NaN, no infinity, whatever the frame"});
}

// Every input has its row, by the default recipe and by its own; times differ between machines.
TEST(VerdictTimes, cover_every_input_of_the_fuzz_corpus) {
    const std::filesystem::path corpus = std::filesystem::path(HORD_SOURCE_DIR) / "tests/fuzz/corpus";
    const auto inputs_of = [&](const char* target) {
        return static_cast<std::size_t>(
            std::distance(std::filesystem::directory_iterator(corpus / target), std::filesystem::directory_iterator()));
    };
    VerdictTimes times;
    ASSERT_TRUE(add_changed_frames(corpus / "verdict", 21, times));
    EXPECT_EQ(times.frames.rows.size(), 2 * inputs_of("verdict"));
    EXPECT_EQ(times.sizes.rows.size(), inputs_of("verdict") + 1);
    times = {};
    const auto done = add_frame_files(corpus / "frame_file", times);
    ASSERT_TRUE(done) << done.error().message();
    EXPECT_EQ(times.frames.rows.size(), inputs_of("frame_file"));
    EXPECT_EQ(add_changed_frames(corpus / "no_such_target", 21, times).error().code, ErrorCode::not_found);
}

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
    EXPECT_EQ(table_of(table).rows.back(), (std::vector<std::string>{"x", "another", "3", "4", "WRONG"}));
}

// The checkers themselves, by hand: three stay, two move from (1,0) to (2,2).
TEST(TransportCheck, is_what_a_hand_computes) {
    const Masses a{1, 2, 0, 0, 1, 1, 0, 0, 0}, b{1, 0, 0, 0, 1, 1, 0, 0, 2};
    EXPECT_NEAR(distance_by_shortest_paths(a, b, *algo::GroundDistance::between_bins(3, 3)), 2 * std::sqrt(5.0) / 5,
                1e-14);
    EXPECT_NEAR(
        distance_by_shortest_paths(a, b, *algo::GroundDistance::between_bins(3, 3, algo::GroundNorm::manhattan)),
        6.0 / 5, 1e-14);
    const Sinkhorn s = sinkhorn(a, b, *algo::GroundDistance::between_bins(3, 3), 0.05, 1e-5, 100'000);
    EXPECT_LE(s.residual, 1e-5);
    EXPECT_NEAR(s.cost, 2 * std::sqrt(5.0) / 5, s.bias + 1e-4);
    EXPECT_LT(s.bias, 0.15);
}

}  // namespace
}  // namespace hord::lab
