#include "algo/maps/row_thread_pool.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

TEST(RowThreadPool, works_on_every_band_once_whatever_the_number_of_threads) {
    for (const int threads : {1, 2, 3, 8}) {
        auto crew = RowThreadPool::create(threads);
        ASSERT_TRUE(crew);
        EXPECT_EQ((*crew)->threads(), threads);
        for (const int bands : {0, 1, 2, 7, 100}) {
            std::vector<std::atomic<int>> visits(static_cast<std::size_t>(bands));
            std::atomic<int> strangers{0};
            (*crew)->share_out(bands, [&](int worker, int band) {
                if (worker < 0 || worker >= threads) ++strangers;
                ++visits[static_cast<std::size_t>(band)];
            });
            for (const auto& count : visits) EXPECT_EQ(count, 1);
            EXPECT_EQ(strangers, 0);
        }
    }
}

// Consecutive bands share rows, which a thread with both bands decodes only once.
TEST(RowThreadPool, gives_a_thread_bands_that_follow_one_another) {
    for (const int threads : {1, 2, 3}) {
        auto crew = RowThreadPool::create(threads);
        ASSERT_TRUE(crew);
        constexpr int kBands = 24;
        std::vector<std::vector<int>> bands(static_cast<std::size_t>(threads));
        for (auto& of_worker : bands) of_worker.reserve(kBands);
        (*crew)->share_out(kBands,
                           [&](int worker, int band) { bands[static_cast<std::size_t>(worker)].push_back(band); });
        for (int worker = 0; worker < threads; ++worker) {
            const auto& of_worker = bands[static_cast<std::size_t>(worker)];
            const int begin = kBands * worker / threads, end = kBands * (worker + 1) / threads;
            std::size_t own = 0;
            while (own < of_worker.size() && of_worker[own] == begin + static_cast<int>(own)) ++own;
            // After its own run, a worker gets bands of other workers only.
            for (std::size_t k = own; k < of_worker.size(); ++k)
                EXPECT_TRUE(of_worker[k] < begin || of_worker[k] >= end);
        }
        const std::size_t taken = std::accumulate(bands.begin(), bands.end(), std::size_t{0},
                                                  [](std::size_t sum, const auto& b) { return sum + b.size(); });
        EXPECT_EQ(taken, std::size_t{kBands});
    }
}

TEST(RowThreadPool, gives_one_thread_one_band_and_many_a_few_each) {
    for (const int rows : {3, 16, 17, 100, 555, 2048}) {
        EXPECT_EQ((*RowThreadPool::create(1))->rows_a_band(rows), rows);
        for (const int threads : {2, 3, 8}) {
            const int of_band = (*RowThreadPool::create(threads))->rows_a_band(rows);
            EXPECT_GE(of_band, std::min(rows, 16));
            EXPECT_LE(of_band, rows);
            EXPECT_LE((rows + of_band - 1) / of_band, 4 * threads);
        }
    }
    EXPECT_EQ((*RowThreadPool::create(2))->rows_a_band(555), 70);
}

TEST(RowThreadPool, shows_the_caller_what_the_others_wrote) {
    auto crew = RowThreadPool::create(4);
    ASSERT_TRUE(crew);
    std::vector<int> written(64);
    for (int round = 1; round <= 300; ++round) {
        (*crew)->share_out(64, [&](int, int band) { written[static_cast<std::size_t>(band)] = round * band; });
        for (int band = 0; band < 64; ++band) ASSERT_EQ(written[static_cast<std::size_t>(band)], round * band);
    }
}

TEST(RowThreadPool, refuses_an_impossible_number_of_threads) {
    EXPECT_FALSE(RowThreadPool::create(0));
    EXPECT_FALSE(RowThreadPool::create(-1));
    EXPECT_FALSE(RowThreadPool::create(RowThreadPool::kMaxThreads + 1));
}

}  // namespace
}  // namespace hord::algo
