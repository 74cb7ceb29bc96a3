// Signs of two exposures in a frame: lenslets that differ in turn, undeflected light, split spots.
#include "algo/light/exposures.h"

#include <functional>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

DeflectionQ bins(double value) {
    return DeflectionQ::from_raw(static_cast<std::int64_t>(value * (1 << DeflectionQ::kFractionBits)));
}

// One value a lenslet.
struct Field {
    Extents extents;
    std::vector<Deflection> deflections = std::vector<Deflection>(extents.lenslets());
    std::vector<std::uint32_t> sums = std::vector<std::uint32_t>(extents.lenslets(), 1000U);
    std::vector<std::uint8_t> mask = std::vector<std::uint8_t>(extents.lenslets(), kValid);
};

Field field(const Extents& e, const std::function<void(Field&, std::size_t k, int m, int n)>& lenslet) {
    Field f{e};
    std::size_t k = 0;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m, ++k) lenslet(f, k, m, n);
    }
    return f;
}

Alternation of(const Field& f) { return alternation(f.extents, f.deflections, f.sums, f.mask, 0, f.extents.n); }

constexpr Extents kBlock{8, 8, 9, 9};

TEST(Alternation, is_half_the_difference_along_rows_columns_or_both) {
    const std::function<int(int, int)> turns[] = {[](int m, int) { return m % 2; }, [](int, int n) { return n % 2; },
                                                  [](int m, int n) { return (m + n) % 2; }};
    for (const auto& turn : turns) {
        const Field f = field(kBlock, [&](Field& to, std::size_t k, int m, int n) {
            const double sign = turn(m, n) == 0 ? 1 : -1;
            to.deflections[k] = {bins(3 + 0.5 * sign), bins(0.25 * sign - 2)};
            to.sums[k] = sign > 0 ? 1200 : 800;
        });
        EXPECT_NEAR(of(f).bins, 0.5, 1e-6);
        EXPECT_NEAR(of(f).light, 0.2, 1e-6);
    }
    const Field down = field(
        kBlock, [](Field& to, std::size_t k, int, int n) { to.deflections[k].y = bins(n % 2 == 0 ? 0.3 : -0.3); });
    EXPECT_NEAR(of(down).bins, 0.3, 1e-6);
    EXPECT_EQ(of(down).light, 0);
}

TEST(Alternation, is_none_of_a_smooth_field_or_of_one_that_turns_every_third_lenslet) {
    const Field smooth = field({24, 16, 9, 9}, [](Field& to, std::size_t k, int m, int n) {
        to.deflections[k] = {bins(0.25 * m), bins(0.125 * n)};
        to.sums[k] = static_cast<std::uint32_t>(1000 + 20 * m + 10 * n);
    });
    EXPECT_EQ(of(smooth).bins, 0);
    EXPECT_EQ(of(smooth).light, 0);
    const Field third = field(
        {24, 16, 9, 9}, [](Field& to, std::size_t k, int m, int) { to.deflections[k].x = bins(m % 3 == 0 ? 1 : 0); });
    EXPECT_EQ(of(third).bins, 0);
}

// Of the 24 places that are read along each axis of a block, 23 must differ in turn (0.95 of 24 is 22.8).
TEST(Alternation, may_miss_one_lenslet_of_a_block_and_not_two) {
    const auto with = [](int steady) {
        Field f = field(
            kBlock, [](Field& to, std::size_t k, int m, int) { to.deflections[k].x = bins(m % 2 == 0 ? 0.5 : -0.5); });
        // The second difference of the last but one lenslet of the row changes its sign, no other.
        for (int n = 0; n < 2 * steady; n += 2) f.deflections[kBlock.index(7, n)].x = bins(1.6);
        return of(f).bins;
    };
    EXPECT_GT(with(0), 0.45);
    EXPECT_GT(with(1), 0.4);
    EXPECT_EQ(with(2), 0);
}

TEST(Alternation, reads_judged_lenslets_with_light_and_needs_twelve) {
    const auto of_mask = [](std::uint8_t left_out, int judged_rows) {
        Field f = field(
            kBlock, [](Field& to, std::size_t k, int m, int) { to.deflections[k].x = bins(m % 2 == 0 ? 0.5 : -0.5); });
        for (int n = 2 * judged_rows; n < kBlock.n; ++n) {
            for (int m = 0; m < kBlock.m; ++m) f.mask[kBlock.index(m, n)] = left_out;
        }
        return of(f).bins;
    };
    for (const std::uint8_t bit : {kDark, kSaturated, kRim, kOutside}) {
        EXPECT_GT(of_mask(bit, 2), 0.4) << int{bit};  // 2 rows that are read, of 6 places each
        EXPECT_EQ(of_mask(bit, 1), 0) << int{bit};
    }
    EXPECT_GT(of_mask(kBorder, 1), 0.4);
}

// Of which sort the brighter ones are does not matter. A lenslet that is left out is in no second difference.
TEST(Alternation, begins_with_either_sort_and_leaves_out_neighbours_of_what_is_not_judged) {
    for (const double first : {0.5, -0.5}) {
        Field f = field(kBlock, [&](Field& to, std::size_t k, int m, int) {
            to.deflections[k].x = bins(m % 2 == 0 ? first : -first);
        });
        EXPECT_NEAR(of(f).bins, 0.5, 1e-6);
        for (int n = 0; n < kBlock.n; ++n) {
            f.mask[kBlock.index(3, n)] = kRim;
            f.deflections[kBlock.index(3, n)].x = bins(first > 0 ? 50 : -50);
        }
        EXPECT_NEAR(of(f).bins, 0.5, 1e-6);  // 12 places are left
    }
}

// The places of a part are worse than the mean of the field: every block of 8 x 8 counts alone, also a cut one.
TEST(Alternation, is_that_of_the_worst_block) {
    for (const auto& [left, top] : {std::pair(0, 0), std::pair(8, 0), std::pair(0, 8), std::pair(16, 16)}) {
        const Field f = field({22, 22, 9, 9}, [left = left, top = top](Field& to, std::size_t k, int m, int n) {
            if (m >= left && n >= top && m < left + 8 && n < top + 8) to.sums[k] = m % 2 == 0 ? 1100 : 900;
        });
        EXPECT_NEAR(of(f).light, 0.1, 0.01) << left << " " << top;
    }
}

TEST(Alternation, of_two_bands_is_the_stronger_one_of_each_kind) {
    const Alternation moved{0.3, 0.1}, dimmed{0.2, 0.4};
    for (const Alternation& most : {moved.or_stronger(dimmed), dimmed.or_stronger(moved)}) {
        EXPECT_EQ(most.bins, 0.3);
        EXPECT_EQ(most.light, 0.4);
    }
}

// A frame of lenslets that are all alike. `light(i, j)` is their samples, DN.
Frame alike(const Extents& e, int bits, const std::function<int(int i, int j)>& light) {
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) frame.set(x, y, static_cast<std::uint32_t>(light(x % e.i, y % e.j)));
    }
    return frame;
}
std::vector<std::uint32_t> first(std::size_t count) {
    std::vector<std::uint32_t> all(count);
    std::iota(all.begin(), all.end(), 0U);
    return all;
}

// Bin (4, 4) is in the middle; (7, 4) lies 3 bins to the right of it, (6, 4) 2, (5, 4) 1.
struct Bins {
    int middle = 0, near = 0, beyond = 0, far = 0;
};
double undeflected(const Bins& b, std::size_t lenslets = 16, std::uint32_t dark = 0, int bits = 8, double x = 0,
                   double y = 0) {
    const Extents e{5, 4, 9, 9};
    const Frame frame = alike(e, bits, [&](int i, int j) {
        if (j != 4) return 0;
        return i == 4 ? b.middle : i == 5 ? b.near : i == 6 ? b.beyond : i == 7 ? b.far : 0;
    });
    return undeflected_share(frame.view(), e, dark, first(lenslets), x, y);
}

TEST(UndeflectedShare, is_the_light_within_one_and_a_half_bins_of_lenslets_that_deflect_light_far) {
    EXPECT_NEAR(undeflected({.middle = 20, .near = 10, .far = 70}), 0.3, 1e-9);
    EXPECT_NEAR(undeflected({.middle = 20, .near = 10, .far = 70}, 16, 0, 12), 0.3, 1e-9);
    EXPECT_NEAR(undeflected({.middle = 25, .near = 15, .far = 75}, 16, 5), 0.3, 1e-9);
    EXPECT_EQ(undeflected({.middle = 100}), 0);
    EXPECT_EQ(undeflected({}), 0);
}

TEST(UndeflectedShare, counts_lenslets_with_a_tenth_of_their_light_far_and_four_fifths_of_the_rest_of_it) {
    EXPECT_NEAR(undeflected({.middle = 90, .far = 10}), 0.9, 1e-9);
    EXPECT_EQ(undeflected({.middle = 91, .far = 9}), 0);
    EXPECT_NEAR(undeflected({.middle = 50, .beyond = 10, .far = 40}), 0.5, 1e-9);
    EXPECT_EQ(undeflected({.middle = 50, .beyond = 11, .far = 39}), 0);
}

TEST(UndeflectedShare, needs_sixteen_lenslets_and_nine_bins) {
    EXPECT_EQ(undeflected({.middle = 20, .far = 80}, 15), 0);
    EXPECT_NEAR(undeflected({.middle = 20, .far = 80}, 16), 0.2, 1e-9);
    for (const Extents& e : {Extents{5, 4, 9, 8}, Extents{5, 4, 8, 9}}) {
        const Frame frame = alike(e, 8, [](int i, int j) { return j == 4 && (i == 4 || i == 7) ? 100 : 0; });
        EXPECT_EQ(undeflected_share(frame.view(), e, 0, first(20), 0, 0), 0);
    }
}

TEST(UndeflectedShare, is_measured_from_where_the_free_light_is) {
    const Bins b{.middle = 20, .beyond = 0, .far = 80};
    EXPECT_NEAR(undeflected(b, 16, 0, 8, 0, 1), 0.2, 1e-9);   // still within 1.5 bins of the middle
    EXPECT_NEAR(undeflected(b, 16, 0, 8, 3, 0), 0.8, 1e-9);   // what lies there is undeflected, the middle is far
    EXPECT_NEAR(undeflected(b, 16, 0, 8, -1, 0), 0.2, 1e-9);  // (7, 4) is farther still
    EXPECT_NEAR(undeflected({.middle = 20, .far = 80}, 16, 0, 8, 0, -1), 0.2, 1e-9);
    EXPECT_NEAR(undeflected({.middle = 20, .far = 80}, 16, 0, 8, 0, 2), 0, 1e-9);  // nothing within 1.5 bins
}

// Rows of bins are those of the lenslet alone.
TEST(UndeflectedShare, reads_every_bin_of_a_lenslet_once) {
    const Extents e{5, 4, 9, 9};
    for (const auto& [i, j] : {std::pair(4, 0), std::pair(4, 8), std::pair(0, 4), std::pair(8, 4)}) {
        const Frame frame = alike(e, 8, [&, far_i = i, far_j = j](int x, int y) {
            return x == 4 && y == 4 ? 20 : x == far_i && y == far_j ? 80 : 0;
        });
        EXPECT_NEAR(undeflected_share(frame.view(), e, 0, first(20), 0, 0), 0.2, 1e-9) << i << " " << j;
    }
}

// The median of three kinds: a third each.
TEST(UndeflectedShare, is_the_median_of_the_lenslets) {
    const Extents e{6, 4, 9, 9};
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int k = 0; k < 24; ++k) {
        frame.set(k % 6 * 9 + 4, k / 6 * 9 + 4, static_cast<std::uint32_t>(10 * (k % 3 + 1)));
        frame.set(k % 6 * 9 + 7, k / 6 * 9 + 4, static_cast<std::uint32_t>(100 - 10 * (k % 3 + 1)));
    }
    EXPECT_NEAR(undeflected_share(frame.view(), e, 0, first(24), 0, 0), 0.2, 1e-9);
}

double split(const std::function<int(int i, int j)>& light, const Extents& e = {4, 4, 9, 9}, std::uint32_t dark = 0) {
    const Frame frame = alike(e, 8, light);
    return split_share(frame.view(), e, dark, first(e.lenslets()));
}

TEST(SplitShare, counts_lenslets_whose_light_lies_at_opposite_edges) {
    EXPECT_EQ(split([](int i, int) { return i == 0 || i == 8 ? 20 : 0; }), 1);
    EXPECT_EQ(split([](int, int j) { return j == 0 || j == 8 ? 20 : 0; }), 1);
    EXPECT_EQ(split([](int i, int) { return i == 0 || i == 7 ? 20 : 0; }, {4, 4, 8, 6}), 1);
    EXPECT_EQ(split([](int i, int) { return i == 0 ? 20 : 0; }), 0);
    EXPECT_EQ(split([](int i, int) { return i == 4 ? 20 : 0; }), 0);
    EXPECT_EQ(split([](int i, int j) { return i == 0 || i == 8 ? (j == 4 ? 20 : 5) : 5; }, {4, 4, 9, 9}, 5), 1);
    const Extents e{4, 4, 9, 9};
    EXPECT_EQ(split_share(Frame(36, 36, 8).view(), e, 0, {}), 0);
}

// Twice the middle, and a tenth of all light, in each of the two.
TEST(SplitShare, needs_twice_the_middle_and_a_tenth_of_the_light_at_both_edges) {
    const auto columns = [](int outer_left, int outer_right, int middle, int between) {
        return split([=](int i, int) {
            return i == 0 ? outer_left : i == 8 ? outer_right : i == 4 ? middle : i == 2 ? between : 0;
        });
    };
    EXPECT_EQ(columns(21, 21, 10, 0), 1);
    EXPECT_EQ(columns(20, 20, 10, 0), 0);
    EXPECT_EQ(columns(40, 20, 10, 0), 0);
    EXPECT_EQ(columns(20, 40, 10, 0), 0);
    EXPECT_EQ(columns(11, 11, 0, 80), 1);
    EXPECT_EQ(columns(10, 10, 0, 80), 0);
}

// Of even numbers of bins the brighter of the two middle ones counts.
TEST(SplitShare, of_even_numbers_of_bins_has_two_middles) {
    for (const int middle : {3, 4})
        EXPECT_EQ(split([=](int i, int) { return i == 0 || i == 7 || i == middle ? 20 : 0; }, {4, 4, 8, 8}), 0);
}

TEST(SplitShare, is_the_share_of_the_given_lenslets) {
    const Extents e{4, 1, 5, 5};
    Frame frame(20, 5, 8);
    for (int y = 0; y < 5; ++y) frame.set(10, y, 50), frame.set(14, y, 50);  // lenslet 2
    EXPECT_EQ(split_share(frame.view(), e, 0, first(4)), 0.25);
    EXPECT_EQ(split_share(frame.view(), e, 0, first(2)), 0);
}

}  // namespace
}  // namespace hord::algo
