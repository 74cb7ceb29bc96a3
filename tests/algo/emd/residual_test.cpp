// The residual of two HORDs against its definition, for every number of bins.
#include "algo/emd/residual.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace hord::algo {
namespace {

// Masses of exactly `bins` bins on the heap, so that a sanitizer detects reads beyond them.
std::vector<std::uint16_t> random_masses(int bins, std::uint32_t one_in, std::uint32_t full_scale,
                                         std::mt19937& random) {
    std::vector<std::uint16_t> mass(static_cast<std::size_t>(bins));
    for (auto& m : mass)
        m = random() % one_in == 0 ? static_cast<std::uint16_t>(1 + random() % full_scale) : std::uint16_t{0};
    mass[random() % mass.size()] = 1;  // never dark
    return mass;
}

Hord hord_of(const std::vector<std::uint16_t>& mass) {
    std::uint32_t sum = 0;
    for (const auto m : mass) sum += m;
    return {mass.data(), sum};
}

struct Expected {
    std::vector<std::int64_t> mass;
    std::vector<int> bin;
};

// Where sign * (a * S_b - b * S_a) is positive.
Expected by_definition(const Hord& a, const Hord& b, int bins, std::int64_t sign) {
    Expected side;
    for (int k = 0; k < bins; ++k) {
        const std::int64_t d = sign * (std::int64_t{a.mass[k]} * b.sum - std::int64_t{b.mass[k]} * a.sum);
        if (d <= 0) continue;
        side.mass.push_back(d);
        side.bin.push_back(k);
    }
    return side;
}

template <class Mass>
void expect_side(const ResidualSide<Mass>& found, const Expected& expected) {
    ASSERT_EQ(found.count, static_cast<int>(expected.bin.size()));
    for (std::size_t k = 0; k < expected.bin.size(); ++k) {
        EXPECT_EQ(static_cast<std::int64_t>(found.mass[k]), expected.mass[k]);
        EXPECT_EQ(found.bin[k], expected.bin[k]);
    }
}

template <class Mass>
void expect_definition(FindResidual<Mass> find, std::uint32_t full_scale) {
    std::mt19937 random(20261121);
    Residual<Mass> residual;
    for (int bins = 9; bins <= kMaxBinCount; ++bins) {
        for (const std::uint32_t one_in : {1U, 3U, 20U}) {
            const auto a = random_masses(bins, one_in, full_scale, random),
                       b = random_masses(bins, one_in, full_scale, random);
            const Hord first = hord_of(a), second = hord_of(b);
            SCOPED_TRACE(std::to_string(bins) + " bins");
            find(first, second, bins, residual);
            expect_side(residual.side[residual.kSurplus], by_definition(first, second, bins, 1));
            expect_side(residual.side[residual.kDeficit], by_definition(first, second, bins, -1));
        }
    }
}

// 225 bins of 200 add up to 45,000, whose square is below 2^31.
constexpr std::uint32_t kLightScale = 200;

TEST(Residual, holds_the_bins_that_differ_in_order_as_doubles) {
    expect_definition<double>(find_residual<double>, 65535);
}

TEST(Residual, holds_int32_masses_on_every_instruction_set) {
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (has(isa)) expect_definition<std::int32_t>(find_residual_for(isa), kLightScale);
    }
}

// Sums around 2^15, the limit of the int16 products.
TEST(Residual, holds_int32_masses_of_any_sum) {
    std::mt19937 random(8);
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (!has(isa)) continue;
        Residual<std::int32_t> residual;
        for (const std::uint16_t sum : {std::uint16_t{1}, std::uint16_t{32766}, std::uint16_t{32767},
                                        std::uint16_t{32768}, std::uint16_t{46340}}) {
            for (const std::uint32_t others : {1U, 2U, 32767U, 32768U, 46340U}) {
                std::vector<std::uint16_t> a(81), b(81);
                const std::size_t at = random() % 81;
                a[at] = sum;  // all mass in one bin, against all but one
                b[at] = static_cast<std::uint16_t>(others - 1);
                b[(at + 1 + random() % 80) % 81] = 1;
                SCOPED_TRACE(std::to_string(sum) + " against " + std::to_string(others));
                find_residual_for(isa)(hord_of(a), hord_of(b), 81, residual);
                expect_side(residual.side[residual.kSurplus], by_definition(hord_of(a), hord_of(b), 81, 1));
                expect_side(residual.side[residual.kDeficit], by_definition(hord_of(a), hord_of(b), 81, -1));
            }
        }
    }
}

TEST(Residual, becomes_the_same_rows_whichever_histogram_comes_first) {
    std::mt19937 random(7);
    Residual<std::int32_t> one, other;
    for (int n = 0; n < 2000; ++n) {
        const auto a = random_masses(81, 8, kLightScale, random), b = random_masses(81, 8, kLightScale, random);
        for (const auto find : {find_residual<std::int32_t>, keep_shared<std::int32_t>}) {
            find(hord_of(a), hord_of(b), 81, one);
            find(hord_of(b), hord_of(a), 81, other);
            if (one.side[0].count == 0) continue;
            const auto& rows = one.side[one.rows()];
            const auto& same = other.side[other.rows()];
            ASSERT_EQ(rows.count, same.count);
            EXPECT_TRUE(std::equal(rows.bin.begin(), rows.bin.begin() + rows.count, same.bin.begin()));
            EXPECT_TRUE(std::equal(rows.mass.begin(), rows.mass.begin() + rows.count, same.mass.begin()));
        }
    }
}

}  // namespace
}  // namespace hord::algo
