// flood_by_runs() against the plain flood(): the same lenslets on random fields.
#include "algo/frame/flood.h"

#include <algorithm>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

TEST(Flood, by_runs_finds_the_lenslets_of_the_plain_one) {
    std::mt19937_64 random(1);
    std::size_t largest = 0;
    for (int round = 0; round < 400; ++round) {
        const Extents e{3 + static_cast<int>(random() % 40), 3 + static_cast<int>(random() % 40), 3, 3};
        const std::uint64_t density = 1 + random() % 9;  // tenths
        std::vector<std::uint8_t> in(e.lenslets());
        for (std::uint8_t& one : in) one = random() % 10 < density ? 1 : 0;
        const auto seed = static_cast<std::uint32_t>(random() % e.lenslets());
        for (const Connected connected : {Connected::at_sides, Connected::at_corners_too}) {
            std::vector<std::uint8_t> plain = in, by_runs = in;
            std::vector<std::uint32_t> queue(e.lenslets()), other;
            std::vector<FloodRun> runs(max_flood_runs(e));
            const std::size_t wanted = flood(e, seed, 1, connected, queue, [&](std::size_t k) {
                return std::exchange(plain[k], std::uint8_t{0}) == 1;
            });
            const Flooded got = flood_by_runs(
                e, seed, connected, runs, [&](std::size_t k) { return by_runs[k] == 1; },
                [&](std::size_t k) { by_runs[k] = 0; });
            ASSERT_EQ(got.lenslets, wanted) << e.m << "x" << e.n << " round " << round;
            ASSERT_EQ(by_runs, plain);
            std::sort(queue.begin(), queue.begin() + static_cast<std::ptrdiff_t>(wanted));
            for (const FloodRun& run : std::span(runs).first(got.runs)) {
                for (std::uint32_t k = run.first; k <= run.last; ++k) other.push_back(k);
            }
            std::sort(other.begin(), other.end());
            queue.resize(wanted);
            ASSERT_EQ(other, queue);
            largest = std::max(largest, wanted);
        }
    }
    EXPECT_GT(largest, 500U);
}

}  // namespace
}  // namespace hord::algo
