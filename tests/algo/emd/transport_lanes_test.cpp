#include "algo/emd/transport_lanes.h"

#include <algorithm>
#include <bit>
#include <vector>

#include <gtest/gtest.h>

#include "algo/emd/transport_cells.h"
#include "tests/algo/emd/transport_problem.h"

namespace hord::algo {
namespace {

using namespace testing;

// Sixteen problems of one shape, each with its costs and a plan.
template <class Mass>
struct Plans {
    Plans(Random& random, int rows, int cols, int total) {
        for (int lane = 0; lane < kBatchLanes; ++lane) {
            problems.emplace_back(random, rows, cols);
            problems.back().share_out(random, total);
        }
    }
    void plan() {
        for (int lane = 0; lane < kBatchLanes; ++lane) {
            steps.push_back(staircase(problems[static_cast<std::size_t>(lane)]));
            hand_over(lane);
        }
    }
    LaneOutcome pivot(Isa isa, std::uint32_t lanes = 0xFFFF) const {
        LaneOutcome outcome{};
        // All lanes have one largest cost: a cell of every problem costs 1.
        lanes_kernel<Mass>(isa)(answer, problems[0].rows, problems[0].cols, lanes, TransportCosts::kMaxCost,
                                TransportSimplex::kTolerance, outcome);
        return outcome;
    }
    // What the simplex makes of the same plan.
    TransportSimplex::Outcome simplex(int lane) const {
        const Problem& p = problems[static_cast<std::size_t>(lane)];
        return p.simplex().solve(p.transport(), steps[static_cast<std::size_t>(lane)].data());
    }

    std::vector<Problem> problems;
    std::vector<std::vector<TransportStep>> steps;
    TransportAnswer<Mass> answer;

  private:
    void hand_over(int lane) {
        Problem& p = problems[static_cast<std::size_t>(lane)];
        const auto& plan = steps[static_cast<std::size_t>(lane)];
        for (int i = 0; i < p.rows; ++i) {
            for (int j = 0; j < p.cols; ++j) answer.cell_cost[i * kFirstColumnNode + j][lane] = p.cost_of(i, j);
        }
        for (std::size_t k = plan.size(); k-- > 0;) {
            const TransportStep& step = plan[k];
            const int column = kFirstColumnNode + step.column, child = step.row_used_up ? step.row : column,
                      parent = step.row_used_up ? column : step.row;
            answer.child[k][lane] = child;
            answer.parent[k][lane] = parent;
            answer.flow[k][lane] = static_cast<Mass>(step.flow);
            if (k + 1 == plan.size()) answer.dual[parent][lane] = 0;
            answer.dual[child][lane] = p.cost_of(step.row, step.column) - answer.dual[parent][lane];
        }
    }
};

template <class Mass>
class TransportLanes : public ::testing::Test {};
using Masses = ::testing::Types<std::int32_t, double>;
TYPED_TEST_SUITE(TransportLanes, Masses);

// Few units make ties, of which the last blocking arc leaves.
TYPED_TEST(TransportLanes, have_the_bits_of_the_simplex) {
    Random random(8);
    int pivots = 0, lanes = 0, unsolved = 0;
    for (int rows = 2; rows <= kMaxBatchSide; ++rows) {
        for (int cols = rows; cols <= kMaxBatchSide; ++cols) {
            for (const int total : {100000, cols + 3}) {
                Plans<TypeParam> plans(random, rows, cols, total);
                for (Problem& p : plans.problems) p.cost_of(0, 0) = 1;
                plans.plan();
                for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
                    if (!has(isa)) continue;
                    const LaneOutcome outcome = plans.pivot(isa);
                    for (int lane = 0; lane < kBatchLanes; ++lane, ++lanes) {
                        if ((outcome.solved >> lane & 1U) == 0) {
                            ++unsolved;
                            continue;
                        }
                        const auto alone = plans.simplex(lane);
                        ASSERT_EQ(outcome.cost[lane], alone.cost) << rows << "x" << cols << " lane " << lane;
                        ASSERT_EQ(outcome.pivots[lane], alone.pivots) << rows << "x" << cols << " lane " << lane;
                        pivots += alone.pivots;
                    }
                }
            }
        }
    }
    EXPECT_GT(pivots, 10000);
    EXPECT_LT(unsolved, lanes / 50);  // duals out of range: the plans are bad ones
}

// Costs of whole tenths: many reduced costs are 0 but for rounding.
TYPED_TEST(TransportLanes, take_rounding_for_no_gain) {
    Random random(9);
    for (int n = 0; n < 50; ++n) {
        Plans<TypeParam> plans(random, 7, 9, 40);
        for (Problem& p : plans.problems) {
            for (double& cost : p.cost) cost = 0.1 * pick(random, 0, 9);
            p.cost_of(0, 0) = 1;
        }
        plans.plan();
        const LaneOutcome outcome = plans.pivot(widest_isa());
        ASSERT_EQ(outcome.solved, 0xFFFFU);
        for (int lane = 0; lane < kBatchLanes; ++lane) ASSERT_EQ(outcome.cost[lane], plans.simplex(lane).cost);
    }
}

TYPED_TEST(TransportLanes, solve_the_lanes_that_are_asked_for_whatever_the_others_hold) {
    Random random(10);
    Plans<TypeParam> plans(random, 6, 8, 1000);
    for (Problem& p : plans.problems) p.cost_of(0, 0) = 1;
    plans.plan();
    const LaneOutcome all = plans.pivot(widest_isa()), some = plans.pivot(widest_isa(), 0x00F1);
    EXPECT_EQ(some.solved, 0x00F1U);
    for (const int lane : {0, 4, 5, 6, 7}) EXPECT_EQ(some.cost[lane], all.cost[lane]);
}

// Costs along the plan alternate between 1 and 0: duals grow from row to row beyond the integer range.
TYPED_TEST(TransportLanes, leave_duals_out_of_range_to_the_simplex) {
    Random random(11);
    Plans<TypeParam> plans(random, kMaxBatchSide, kMaxBatchSide, 1000);
    for (Problem& p : plans.problems) p.cost_of(0, 0) = 1;
    Problem& far = plans.problems[3];
    for (int k = 0; k < far.rows; ++k) {
        far.cost_of(k, k) = 1;
        if (k > 0) far.cost_of(k, k - 1) = 0;
    }
    std::ranges::fill(far.supply, 2);
    std::ranges::fill(far.demand, 2);
    far.supply.front() = far.demand.back() = 1;
    plans.plan();
    const LaneOutcome outcome = plans.pivot(widest_isa());
    EXPECT_EQ(outcome.solved >> 3 & 1U, 0U);
    EXPECT_GT(std::popcount(outcome.solved), kBatchLanes / 2);
    for (std::uint32_t rest = outcome.solved; rest != 0; rest &= rest - 1) {
        const int lane = std::countr_zero(rest);
        EXPECT_EQ(outcome.cost[lane], plans.simplex(lane).cost);
    }
}

}  // namespace
}  // namespace hord::algo
