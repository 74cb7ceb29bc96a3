#include "algo/emd/emd_solver.h"

#include <gtest/gtest.h>

#include "tests/algo/emd/transport_oracle.h"
#include "tests/support/histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

// The error bound of algo/emd/emd_solver.h. The oracle is more exact.
constexpr double kContract = 1e-9;

GroundDistance bins_apart(int i, int j, GroundNorm norm = GroundNorm::euclidean,
                          double threshold = GroundDistance::kNoThreshold) {
    return *GroundDistance::between_bins(i, j, norm, threshold);
}

double distance(const Histogram& a, const Histogram& b, const GroundDistance& ground) {
    auto solver = EmdSolver::create(ground);
    return solver->distance(hord_of(a), hord_of(b));
}

// -- by hand

TEST(Emd, moves_one_spot_by_its_euclidean_distance) {
    Histogram a(81), b(81);
    a[0] = 200;
    b[4 * 9 + 3] = 50;  // 3 right, 4 down
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(9, 9)), 5.0);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(9, 9, GroundNorm::manhattan)), 7.0);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(9, 9, GroundNorm::squared_euclidean)), 25.0);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(9, 9, GroundNorm::euclidean, 2.5)), 2.5);
}

// Masses of five: three stay, two move from (1,0) to (2,2), a Manhattan distance of three bins each: six units of work.
TEST(Emd, sums_work_over_the_mass) {
    const Histogram a{1, 2, 0, 0, 1, 1, 0, 0, 0};
    const Histogram b{1, 0, 0, 0, 1, 1, 0, 0, 2};
    // Bin 1 = (1,0), bin 8 = (2,2): sqrt(5) each for two of five units.
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(3, 3)), 2 * std::sqrt(5.0) / 5);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(3, 3, GroundNorm::manhattan)), 6.0 / 5);
}

// The moves of the paper's Fig. 4 (its histograms are not published): three units move one bin each, one unit moves
// three. The work is 6; the EMD is the work over the four units moved.
TEST(Emd, is_the_work_of_the_moves_over_the_mass_moved) {
    Histogram a(9 * 9), b(9 * 9);
    const auto move = [&](int from_i, int from_j, int to_i, int to_j) {
        a[static_cast<std::size_t>(from_j * 9 + from_i)] = 1, b[static_cast<std::size_t>(to_j * 9 + to_i)] = 1;
    };
    move(0, 0, 1, 0), move(8, 0, 8, 1), move(0, 8, 0, 7), move(4, 4, 7, 4);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(9, 9)), (1 + 1 + 1 + 3) / 4.0);
}

TEST(Emd, splits_a_mass_between_the_two_nearest_places) {
    // A line of bins: supply 4 at 0 and 2 at 6; demand 3 at 1 and 3 at 4. 3 move 0->1, 1 moves 0->4, 2 move 6->4.
    Histogram a(15 * 3), b(15 * 3);
    a[0] = 4, a[6] = 2;
    b[1] = 3, b[4] = 3;
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(15, 3)), (3 * 1 + 1 * 4 + 2 * 2) / 6.0);
}

TEST(Emd, compares_shapes_not_exposures) {
    const Histogram a{1, 0, 3, 0, 0, 0, 2, 0, 0}, b{0, 2, 0, 2, 0, 0, 0, 1, 0};
    Histogram brighter = a;
    for (auto& mass : brighter) mass = static_cast<std::uint16_t>(mass * 4);
    EXPECT_NEAR(distance(a, b, bins_apart(3, 3)), distance(brighter, b, bins_apart(3, 3)), 1e-14);
    EXPECT_EQ(distance(a, brighter, bins_apart(3, 3)), 0);
}

TEST(Emd, keeps_shared_mass_where_the_ground_is_no_metric) {
    // Three bins in a line, one unit in the first two against the last two: with squared costs both units move one bin
    // (2 in all); cancelling the shared middle would move one unit two bins (4 in all).
    const Histogram a{1, 1, 0, 0, 0, 0, 0, 0, 0}, b{0, 1, 1, 0, 0, 0, 0, 0, 0};
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(3, 3, GroundNorm::squared_euclidean)), 1.0);
    EXPECT_DOUBLE_EQ(distance(a, b, bins_apart(3, 3)), 1.0);
}

TEST(Emd, of_a_dark_lenslet_is_zero_and_finite) {
    const Histogram dark(9), lit{0, 0, 5, 0, 0, 0, 0, 0, 0};
    EXPECT_EQ(distance(dark, lit, bins_apart(3, 3)), 0);
    EXPECT_EQ(distance(dark, dark, bins_apart(3, 3)), 0);
}

TEST(Emd, survives_sums_at_the_limit_of_the_type) {
    Histogram a(225, 65535), b(225, 65535);
    a[0] = 65534;
    b[224] = 65534;
    const double moved = 1.0 / (65535.0 * 225 - 1);
    EXPECT_NEAR(distance(a, b, bins_apart(15, 15)), moved * std::sqrt(14.0 * 14 * 2), 1e-15);
}

// -- against an independent solver

struct Shape {
    int i, j;
};
class EmdOnShape : public ::testing::TestWithParam<Shape> {};

TEST_P(EmdOnShape, agrees_with_lemon_for_8_to_16_bits_and_every_ground) {
    const auto [i, j] = GetParam();
    Random random(static_cast<unsigned>(i * 100 + j));
    for (const auto& ground :
         {bins_apart(i, j), bins_apart(i, j, GroundNorm::manhattan), bins_apart(i, j, GroundNorm::squared_euclidean),
          bins_apart(i, j, GroundNorm::euclidean, 2.0)}) {
        auto solver = EmdSolver::create(ground);
        for (const int bits : {8, 10, 12, 16}) {
            const int full = (1 << bits) - 1;
            for (int n = 0; n < 3; ++n) {
                const Histogram pairs[][2] = {
                    {blob(random, i, j, full, 0.7), blob(random, i, j, full, 0.7)},
                    {two_lobes(random, i, j, full), two_lobes(random, i, j, full)},
                    {scattered(random, i * j, i * j / 2, full), blob(random, i, j, full, 2.0)}};
                for (const auto& [a, b] : pairs) {
                    EXPECT_NEAR(solver->distance(hord_of(a), hord_of(b)), lemon_distance(a, b, ground), kContract);
                }
            }
        }
        EXPECT_EQ(solver->counters().unproven, 0U);
    }
}

std::vector<Shape> every_shape() {
    std::vector<Shape> shapes;
    for (int side = 3; side <= 15; ++side) shapes.push_back({side, side});
    for (const Shape s : {Shape{3, 15}, {15, 3}, {4, 7}, {9, 8}, {10, 15}}) shapes.push_back(s);
    return shapes;
}
INSTANTIATE_TEST_SUITE_P(bins, EmdOnShape, ::testing::ValuesIn(every_shape()), [](const auto& shape) {
    return std::to_string(shape.param.i) + "x" + std::to_string(shape.param.j);
});

TEST(Emd, agrees_with_lemon_on_dense_histograms) {
    Random random(7);
    const auto ground = bins_apart(9, 9);
    auto solver = EmdSolver::create(ground);
    for (int n = 0; n < 40; ++n) {
        const Histogram a = scattered(random, 81, 400, 255), b = scattered(random, 81, 400, 255);
        EXPECT_NEAR(solver->distance(hord_of(a), hord_of(b)), lemon_distance(a, b, ground), kContract);
    }
}

// With more than 48 rows, one pricing step covers only some of them. Before a plan is accepted, the doubtful cells of
// all rows are computed exactly. One of 9,000 pairs of random histograms needs this: if only the last rows are checked,
// its distance is 3e-8 too large.
TEST(Emd, doubts_the_cells_of_all_rows_where_there_are_many) {
    std::mt19937 random(6);
    Histogram a(225), b(225);
    for (int pair = 0; pair <= 89; ++pair) {
        for (std::size_t k = 0; k < a.size(); ++k) {
            a[k] = static_cast<std::uint16_t>(random() % 219);
            b[k] = static_cast<std::uint16_t>(random() % 219);
        }
    }
    EXPECT_NEAR(distance(a, b, bins_apart(15, 15)), lemon_distance(a, b, bins_apart(15, 15)), kContract);
}

// Small equal masses on a small grid: nearly every pivot is a tie. 60,000 pairs; with HORD_LONG_TESTS 1e6.
TEST(Emd, ends_and_is_exact_on_degenerate_ties) {
    const int pairs = std::getenv("HORD_LONG_TESTS") != nullptr ? 1'000'000 : 60'000;
    Random random(11);
    const GroundDistance grounds[] = {bins_apart(5, 5), bins_apart(3, 3, GroundNorm::manhattan),
                                      bins_apart(4, 3, GroundNorm::squared_euclidean)};
    for (const auto& ground : grounds) {
        auto solver = EmdSolver::create(ground);
        const int bins = ground.bins();
        for (int n = 0; n < pairs / 3; ++n) {
            Histogram a = scattered(random, bins, pick(random, 3, bins), 1 + n % 3), b = a;
            std::shuffle(b.begin(), b.end(), random);
            ASSERT_NEAR(solver->distance(hord_of(a), hord_of(b)), lemon_distance(a, b, ground), kContract);
        }
        EXPECT_EQ(solver->counters().unproven, 0U);
    }
}

// Coincident directions, and the largest allowed ones.
TEST(Emd, agrees_with_lemon_on_direction_maps) {
    Random random(13);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (const double scale : {1.0, 4.0, GroundDistance::kMaxDirection}) {
        std::vector<Direction> directions;
        for (int k = 0; k < 20; ++k) directions.push_back({scale * unit(random), scale * unit(random)});
        for (int k = 20; k < 25; ++k) directions.push_back(directions[static_cast<std::size_t>(k - 20)]);
        const auto ground = GroundDistance::between_directions(5, 5, directions);
        ASSERT_TRUE(ground);
        auto solver = EmdSolver::create(*ground);
        for (int n = 0; n < 200; ++n) {
            const Histogram a = scattered(random, 25, 12, 255), b = scattered(random, 25, 12, 255);
            EXPECT_NEAR(solver->distance(hord_of(a), hord_of(b)), lemon_distance(a, b, *ground),
                        kContract * std::max(1.0, ground->largest() / 20));
        }
    }
}

// A calibrated map is nearly regular: many costs are equal as floats. Two bins against several, alone and in batches.
TEST(Emd, agrees_with_lemon_where_costs_are_nearly_equal) {
    Random random(15);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (const double away : {1e-3, 1e-5, 1e-6, 1e-8}) {
        std::vector<Direction> directions;
        for (int k = 0; k < 81; ++k) directions.push_back({k % 9 + away * unit(random), k / 9 + away * unit(random)});
        for (const GroundNorm norm : {GroundNorm::euclidean, GroundNorm::squared_euclidean}) {
            const auto ground = *GroundDistance::between_directions(9, 9, directions, norm);
            auto solver = EmdSolver::create(ground);
            std::vector<Histogram> h;
            for (int n = 0; n < 600; ++n) h.push_back(scattered(random, 81, n % 2 == 0 ? 2 : 7, 255));
            std::vector<double> out(h.size());
            for (std::size_t n = 1; n < h.size(); ++n) solver->submit(hord_of(h[n - 1]), hord_of(h[n]), &out[n]);
            solver->finish();
            for (std::size_t n = 1; n < h.size(); ++n) {
                const double right = lemon_distance(h[n - 1], h[n], ground),
                             slack = kContract * std::max(1.0, ground.largest() / 20);
                ASSERT_NEAR(solver->distance(hord_of(h[n - 1]), hord_of(h[n])), right, slack);
                ASSERT_NEAR(out[n], right, slack);
            }
            EXPECT_EQ(solver->counters().unproven, 0U);
        }
    }
}

// -- same bits

// Alone or in batches, on every instruction set of this processor.
TEST(Emd, gives_the_same_bits_side_by_side_and_on_every_instruction_set) {
    for (const auto& ground : {bins_apart(9, 9), bins_apart(4, 7, GroundNorm::squared_euclidean)}) {
        const int i = ground.bins_i(), j = ground.bins_j();
        Random random(31);
        std::vector<Histogram> h;
        for (int n = 0; n < 3000; ++n) {
            h.push_back(n % 5 == 0       ? scattered(random, i * j, 1 + n % 60, 255)
                            : n % 5 == 1 ? two_lobes(random, i, j, 4095)
                            : n % 5 == 2 ? scattered(random, i * j, 4, 2)
                                         : blob(random, i, j, 255, 0.6));
        }
        auto alone = EmdSolver::create(ground, Isa::portable);
        std::vector<double> expected;
        for (std::size_t n = 1; n < h.size(); ++n)
            expected.push_back(alone->distance(hord_of(h[n - 1]), hord_of(h[n])));
        for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
            auto solver = EmdSolver::create(ground, isa);
            EXPECT_EQ(solver.has_value(), has(isa));
            if (!solver) continue;
            std::vector<double> out(expected.size(), -1);
            for (std::size_t n = 1; n < h.size(); ++n) solver->submit(hord_of(h[n - 1]), hord_of(h[n]), &out[n - 1]);
            solver->finish();
            EXPECT_EQ(out, expected);
        }
    }
}

// -- properties

TEST(Emd, is_a_metric_on_histograms_and_at_least_the_distance_of_means) {
    Random random(17);
    const auto ground = bins_apart(9, 9);
    auto solver = EmdSolver::create(ground);
    for (int n = 0; n < 2000; ++n) {
        const Histogram h[3] = {blob(random, 9, 9, 255, 0.7), two_lobes(random, 9, 9, 255),
                                scattered(random, 81, 1 + n % 60, 255)};
        const double ab = solver->distance(hord_of(h[0]), hord_of(h[1]));
        const double bc = solver->distance(hord_of(h[1]), hord_of(h[2]));
        const double ac = solver->distance(hord_of(h[0]), hord_of(h[2]));
        ASSERT_LE(ac, ab + bc + kContract);
        ASSERT_EQ(ab, solver->distance(hord_of(h[1]), hord_of(h[0])));
        ASSERT_EQ(solver->distance(hord_of(h[0]), hord_of(h[0])), 0);
        double mean[2][2] = {};
        for (int k = 0; k < 2; ++k) {
            for (std::size_t bin = 0; bin < 81; ++bin) {
                mean[k][0] += static_cast<double>(h[k][bin]) * static_cast<double>(bin % 9) / hord_of(h[k]).sum;
                mean[k][1] += static_cast<double>(h[k][bin]) * static_cast<double>(bin / 9) / hord_of(h[k]).sum;
            }
        }
        ASSERT_GE(ab, std::hypot(mean[0][0] - mean[1][0], mean[0][1] - mean[1][1]) - kContract);
    }
}

TEST(Emd, does_not_change_when_both_are_transposed_or_mirrored) {
    Random random(19);
    auto solver = EmdSolver::create(bins_apart(7, 7));
    for (int n = 0; n < 500; ++n) {
        const Histogram a = blob(random, 7, 7, 4095, 1.2), b = two_lobes(random, 7, 7, 4095);
        Histogram at(49), bt(49), am(49), bm(49);
        for (std::size_t k = 0; k < 49; ++k) {
            at[(k % 7) * 7 + k / 7] = a[k], bt[(k % 7) * 7 + k / 7] = b[k];
            am[k / 7 * 7 + 6 - k % 7] = a[k], bm[k / 7 * 7 + 6 - k % 7] = b[k];
        }
        const double d = solver->distance(hord_of(a), hord_of(b));
        ASSERT_NEAR(solver->distance(hord_of(at), hord_of(bt)), d, kContract);
        ASSERT_NEAR(solver->distance(hord_of(am), hord_of(bm)), d, kContract);
    }
}

// -- refusals

TEST(GroundDistance, refuses_what_cannot_be_a_ground_distance) {
    EXPECT_FALSE(GroundDistance::between_bins(2, 9));
    EXPECT_FALSE(GroundDistance::between_bins(9, 16));
    EXPECT_FALSE(GroundDistance::between_bins(9, 9, GroundNorm::euclidean, 0.0));
    EXPECT_FALSE(GroundDistance::between_bins(9, 9, GroundNorm::euclidean, std::nan("")));
    std::vector<Direction> directions(9);
    EXPECT_TRUE(GroundDistance::between_directions(3, 3, directions));
    EXPECT_FALSE(GroundDistance::between_directions(3, 4, directions));
    directions[4].y = std::nan("");
    EXPECT_FALSE(GroundDistance::between_directions(3, 3, directions));
    directions[4].y = 2e6;
    EXPECT_FALSE(GroundDistance::between_directions(3, 3, directions));
}

}  // namespace
}  // namespace hord::algo
