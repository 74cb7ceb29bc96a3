// Compacted HORDs and pairs of them, compared with the HORDs they are made of.
#include "algo/emd/sparse_hord.h"

#include <gtest/gtest.h>

#include "algo/emd/emd_solver.h"
#include "algo/frame/occupied_bins.h"
#include "tests/support/histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

constexpr Isa kIsas[] = {Isa::portable, Isa::avx2, Isa::avx512};
constexpr const char* kOnlyPortable = "this processor has no instruction set that closes HORDs up";

// A row with contiguous masses on the heap, so that a sanitizer detects reads beyond them.
struct Row {
    int bins = 0;
    std::vector<std::uint16_t> masses;
    std::vector<std::uint32_t> sums;
    std::vector<SparseHord> sparse;

    void add(const Histogram& h) {
        bins = static_cast<int>(h.size());
        masses.insert(masses.end(), h.begin(), h.end());
        sums.push_back(hord_of(h).sum);
    }
    // Overwrites earlier results, as in a window of rows.
    void compact(CompactFunction by) {
        sparse.resize(sums.size());
        std::ranges::reverse(sparse);
        by(masses.data(), sums, bins, sparse.data());
    }
    [[nodiscard]] Hord hord(std::size_t k) const {
        return {masses.data() + k * static_cast<std::size_t>(bins), sums[k]};
    }
};

// Up to `most` lit bins, at most `apart` bins from each other.
Histogram near_each_other(Random& random, int bins, int most, int apart, int full_scale) {
    Histogram h(static_cast<std::size_t>(bins));
    const int first = pick(random, 0, bins - 1);
    for (int n = pick(random, 1, most); n > 0; --n) {
        h[static_cast<std::size_t>(std::min(first + pick(random, 0, apart), bins - 1))] =
            static_cast<std::uint16_t>(pick(random, 1, full_scale));
    }
    return h;
}

// The definition: lit bins and their masses in order; compacted if they are at most eight within 48 bins.
void expect_definition(const SparseHord& sparse, const Hord& h, int bins) {
    std::vector<int> lit;
    for (int k = 0; k < bins; ++k) {
        if (h.mass[k] != 0) lit.push_back(k);
    }
    EXPECT_EQ(sparse.hord().mass, h.mass);
    EXPECT_EQ(sparse.hord().sum, h.sum);
    const bool few = !lit.empty() && lit.size() <= kMaxSparseBins && lit.back() - lit.front() < kMaxSparseSpan;
    ASSERT_EQ(sparse.is_compacted(), few);
    if (!few) return;
    EXPECT_EQ(sparse.compacted_sum, h.sum);
    std::uint64_t set = 0;
    for (std::size_t k = 0; k < lit.size(); ++k) {
        EXPECT_EQ(sparse.bin[k], lit[k]);
        EXPECT_EQ(sparse.mass[k], h.mass[lit[k]]);
        set |= std::uint64_t{1} << (lit[k] - lit.front());
    }
    EXPECT_EQ(sparse.lit, set);
}

TEST(SparseHord, has_the_lit_bins_of_every_number_of_bins) {
    if (!has(Isa::avx2)) GTEST_SKIP() << kOnlyPortable;
    for (const Isa isa : kIsas) {
        if (isa == Isa::portable || !has(isa)) continue;
        Random random(3);
        for (int bins = 9; bins <= kMaxBinCount; ++bins) {
            Row row;
            for (int n = 0; n < 40; ++n)
                row.add(near_each_other(random, bins, n % 2 == 0 ? 4 : 10, n % 3 == 0 ? 60 : 20, 65535));
            row.add(Histogram(static_cast<std::size_t>(bins)));
            row.compact(sparse_kernels(isa).compact);
            row.compact(sparse_kernels(isa).compact);
            SCOPED_TRACE(std::to_string(bins) + " bins");
            for (std::size_t k = 0; k < row.sums.size(); ++k) expect_definition(row.sparse[k], row.hord(k), bins);
        }
    }
}

TEST(SparseHord, is_left_as_it_is_where_there_is_no_instruction_for_it) {
    Row row;
    row.add(Histogram{0, 7, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    row.compact(sparse_kernels(Isa::portable).compact);
    EXPECT_FALSE(row.sparse[0].is_compacted());
    EXPECT_EQ(row.sparse[0].hord().sum, 8U);
    SparseDifference difference;
    EXPECT_EQ(sparse_kernels(Isa::portable).subtract(row.sparse[0], row.sparse[0], difference), 0);
}

// The limits: S_a * S_b < 2^31; first lit bins at most 16 apart; a span of at most 48 bins.
TEST(SparseDifference, is_found_up_to_its_limits) {
    if (!has(Isa::avx2)) GTEST_SKIP() << kOnlyPortable;
    const auto count = [](std::uint32_t sum_a, std::uint32_t sum_b, int b_first, int b_span) {
        Histogram a(225), b(225);
        a[10] = static_cast<std::uint16_t>(sum_a / 2), a[12] = static_cast<std::uint16_t>(sum_a - sum_a / 2);
        const auto first = static_cast<std::size_t>(b_first);
        b[first] = static_cast<std::uint16_t>(sum_b / 2),
        b[first + static_cast<std::size_t>(b_span) - 1] = static_cast<std::uint16_t>(sum_b - sum_b / 2);
        Row row;
        row.add(a);
        row.add(b);
        const SparseKernels kernels = sparse_kernels(best_isa());
        row.compact(kernels.compact);
        SparseDifference difference{};
        EXPECT_EQ(kernels.subtract(row.sparse[1], row.sparse[0], difference) > 0,
                  kernels.subtract(row.sparse[0], row.sparse[1], difference) > 0);
        const int bins = kernels.subtract(row.sparse[0], row.sparse[1], difference);
        if (bins > 0) {
            EXPECT_EQ(difference.excess[bins - 1], -static_cast<std::int64_t>(sum_b - sum_b / 2) * sum_a);
        }
        return bins;
    };
    EXPECT_EQ(count(32768, 65536, 20, 2), 0);
    EXPECT_EQ(count(32768, 65535, 20, 2), 4);
    EXPECT_EQ(count(30, 40, 26, 48), 4);
    EXPECT_EQ(count(30, 40, 27, 48), 0);
    EXPECT_EQ(count(30, 40, 26, 49), 0);
}

TEST(SparseDifference, is_the_definition_wherever_it_is_found) {
    if (!has(Isa::avx2)) GTEST_SKIP() << kOnlyPortable;
    for (const Isa isa : kIsas) {
        if (isa == Isa::portable || !has(isa)) continue;
        const SparseKernels kernels = sparse_kernels(isa);
        Random random(4);
        int found = 0;
        for (int round = 0; round < 4000; ++round) {
            const int bins = pick(random, 16, kMaxBinCount), full_scale = round % 2 == 0 ? 255 : 9000;
            Row row;
            row.add(near_each_other(random, bins, 5, 30, full_scale));
            const std::size_t first = static_cast<std::size_t>(
                std::ranges::find_if(row.masses, [](auto m) { return m != 0; }) - row.masses.begin());
            Histogram other = near_each_other(random, bins, 5, 30, full_scale);
            if (round % 3 != 0) {  // a HORD that overlaps
                other.assign(other.size(), 0);
                for (int n = 0; n < 4; ++n)
                    other[std::min(first + static_cast<std::size_t>(pick(random, 0, 12)), other.size() - 1)] =
                        static_cast<std::uint16_t>(pick(random, 1, full_scale));
            }
            row.add(other);
            row.compact(kernels.compact);
            const Hord a = row.hord(0), b = row.hord(1);
            SparseDifference difference;
            const int count = kernels.subtract(row.sparse[0], row.sparse[1], difference);
            std::vector<int> either;
            for (int k = 0; k < bins; ++k) {
                if ((a.mass[k] | b.mass[k]) != 0) either.push_back(k);
            }
            const bool light = std::uint64_t{a.sum} * b.sum < (std::uint64_t{1} << 31);
            if (count == 0) {
                const bool both = row.sparse[0].is_compacted() && row.sparse[1].is_compacted();
                EXPECT_TRUE(!both || !light || either.size() > kMaxSparseBins ||
                            std::abs(row.sparse[0].bin[0] - row.sparse[1].bin[0]) > kMaxSparseShift);
                continue;
            }
            ++found;
            ASSERT_EQ(count, static_cast<int>(either.size()));
            EXPECT_TRUE(light);
            EXPECT_EQ(static_cast<std::uint64_t>(difference.denominator), std::uint64_t{a.sum} * b.sum);
            for (std::size_t k = 0; k < kMaxSparseBins; ++k) {
                if (k >= either.size()) {
                    EXPECT_EQ(difference.excess[k], 0);
                    continue;
                }
                EXPECT_EQ(difference.bin[k], either[k]);
                EXPECT_EQ(difference.excess[k],
                          std::int64_t{a.mass[either[k]]} * b.sum - std::int64_t{b.mass[either[k]]} * a.sum);
            }
        }
        EXPECT_GT(found, 1500);
    }
}

// Every solver returns the bits of distance(): few bins, more, many, none, equal masses, masses beyond the int32 limit,
// dark.
TEST(SparseHord, gives_the_distance_of_the_hord_to_the_last_bit) {
    const GroundDistance grounds[] = {*GroundDistance::between_bins(9, 9),
                                      *GroundDistance::between_bins(9, 9, GroundNorm::manhattan),
                                      *GroundDistance::between_bins(9, 9, GroundNorm::squared_euclidean),
                                      *GroundDistance::between_bins(15, 15), *GroundDistance::between_bins(3, 3)};
    for (const GroundDistance& ground : grounds) {
        Random random(5);
        Row row;
        for (int n = 0; n < 6000; ++n) {
            const int kind = n / 60 % 7, bins = ground.bins();
            if (kind == 6 && n % 60 != 0) {  // the same HORD, or with three times the exposure
                Histogram again(row.masses.end() - bins, row.masses.end());
                const bool fits = std::ranges::max(again) * 3 < 65536;
                for (auto& m : again) m = static_cast<std::uint16_t>(n % 2 == 0 && fits ? m * 3 : m);
                row.add(again);
                continue;
            }
            row.add(kind == 0                    ? near_each_other(random, bins, 3, 3, 255)
                        : kind == 1              ? near_each_other(random, bins, 4, 12, 3)
                        : kind == 2              ? blob(random, ground.bins_i(), ground.bins_j(), 255, 0.5)
                        : kind == 3              ? near_each_other(random, bins, 3, 2, 65535)
                        : kind == 4 || kind == 6 ? near_each_other(random, bins, 9, 11, 4)
                        : n % 9 == 0             ? Histogram(static_cast<std::size_t>(bins))
                                                 : scattered(random, bins, 1 + n % 30, 255));
        }
        auto alone = EmdSolver::create(ground, Isa::portable);
        std::vector<double> expected;
        for (std::size_t k = 1; k < row.sums.size(); ++k)
            expected.push_back(alone->distance(row.hord(k - 1), row.hord(k)));
        for (const Isa isa : kIsas) {
            if (!has(isa)) continue;
            auto solver = EmdSolver::create(ground, isa);
            // Compacted by this solver, and by one for another ground and instruction set.
            for (const CompactFunction compact :
                 {solver->compact(), sparse_kernels(isa == Isa::portable ? best_isa() : isa).compact}) {
                row.compact(compact);
                std::vector<double> out(expected.size(), -1);
                for (std::size_t k = 1; k < row.sums.size(); ++k) {
                    solver->submit(row.sparse[k - 1], row.sparse[k], &out[k - 1]);
                    if (k % 500 == 0) solver->finish();
                }
                solver->finish();
                EXPECT_EQ(out, expected);
            }
            EXPECT_EQ(solver->counters().pairs, 2 * expected.size());
            const bool compacts = isa != Isa::portable && ground.is_metric();
            EXPECT_EQ(solver->counters().knapsack > 300, compacts) << solver->counters().knapsack;
        }
    }
}

// Costs that are equal as floats: pairs that the knapsack batch cannot prove go to the transport batch.
TEST(SparseHord, gives_the_same_where_few_bins_prove_nothing) {
    Random random(6);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    std::vector<Direction> directions;
    for (int k = 0; k < 81; ++k) directions.push_back({k % 9 + 1e-6 * unit(random), k / 9 + 1e-6 * unit(random)});
    const auto ground = *GroundDistance::between_directions(9, 9, directions, GroundNorm::euclidean);
    Row row;
    // Two bins of a line against one to the upper right and one below: both gain nearly the same.
    for (int n = 0; n < 4000; ++n) {
        Histogram h(81);
        for (const int k : n % 2 == 0 ? std::vector<int>{36, 38} : std::vector<int>{32, 44, 50})
            h[static_cast<std::size_t>(k)] = static_cast<std::uint16_t>(pick(random, 1, 9));
        row.add(h);
    }
    auto alone = EmdSolver::create(ground, Isa::portable), solver = EmdSolver::create(ground);
    row.compact(solver->compact());
    std::vector<double> out(row.sums.size());
    for (std::size_t k = 1; k < row.sums.size(); ++k) solver->submit(row.sparse[k - 1], row.sparse[k], &out[k]);
    solver->finish();
    for (std::size_t k = 1; k < row.sums.size(); ++k) ASSERT_EQ(out[k], alone->distance(row.hord(k - 1), row.hord(k)));
    if (best_isa() == Isa::portable) return;
    EXPECT_GT(solver->counters().knapsack, 100U);
    EXPECT_LT(solver->counters().knapsack, solver->counters().pairs);
}

}  // namespace
}  // namespace hord::algo
