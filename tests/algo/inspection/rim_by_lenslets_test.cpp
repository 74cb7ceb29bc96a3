// RimFinder and flood fills work on rows of lenslets by vectors. Here the same rules, one lenslet after the other, on
// random fields: the free light, the rim, and what is told of the part.
#include <algorithm>
#include <cmath>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/flood.h"
#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/fixed.h"

namespace hord::algo {
namespace {

using namespace outline;

struct Field {
    Extents e;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums;
    std::vector<std::uint8_t> mask;
};

// Free light with noise, and up to four discs and boxes that are deflected, dark, hollow, or lit by half.
Field random_field(std::mt19937_64& random) {
    Field f;
    f.e = {3 + static_cast<int>(random() % 150), 3 + static_cast<int>(random() % 60), 9, 9};
    std::vector<double> x(f.e.lenslets()), light(f.e.lenslets(), 200);
    for (std::uint64_t left = random() % 5; left > 0; --left) {
        const auto at_m = static_cast<int>(random() % 150), at_n = static_cast<int>(random() % 60),
                   radius = 2 + static_cast<int>(random() % 40);
        const std::uint64_t kind = random() % 5;
        const bool box = random() % 2 == 0;
        for (int n = 0; n < f.e.n; ++n) {
            for (int m = 0; m < f.e.m; ++m) {
                const double away =
                    box ? std::max(std::abs(m - at_m), std::abs(n - at_n)) : std::hypot(m - at_m, n - at_n);
                if (away > radius || (kind == 3 && away < radius - 2)) continue;
                if (kind == 1) light[f.e.index(m, n)] = 0;
                else if (kind == 2) light[f.e.index(m, n)] = 100;
                else x[f.e.index(m, n)] = kind == 4 ? static_cast<double>(m - at_m) / radius : 1;
            }
        }
    }
    std::uniform_real_distribution<double> noise(-0.1, 0.1);
    for (std::size_t k = 0; k < f.e.lenslets(); ++k) {
        const bool dark = light[k] == 0;
        const auto raw = [&](double bins) { return DeflectionQ::from_raw(std::llround(bins * (1 << 24))); };
        f.deflections.push_back(dark ? Deflection{} : Deflection{raw(x[k] + noise(random)), raw(noise(random))});
        f.sums.push_back(static_cast<std::uint32_t>(light[k]));
        f.mask.push_back(dark ? kDark : random() % 200 == 0 ? kSaturated : kValid);
    }
    return f;
}

// Free light that is connected to the field's border through lenslets whose neighbours are all free, and what touches
// it.
std::vector<std::uint8_t> reached_in(const Extents& e, std::span<const std::uint8_t> state) {
    std::vector<std::uint8_t> wide(e.lenslets()), reached(e.lenslets());
    std::vector<std::uint32_t> queue(e.lenslets());
    const auto is_border = [&](int m, int n) { return m == 0 || n == 0 || m == e.m - 1 || n == e.n - 1; };
    const auto for_each = [&](auto&& visit) {
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) visit(m, n, e.index(m, n));
        }
    };
    for_each([&](int m, int n, std::size_t k) {
        bool all_free = true;
        e.for_each_around(m, n, 1, [&](int x, int y) { all_free = all_free && (state[e.index(x, y)] & kFree) != 0; });
        wide[k] = all_free || (is_border(m, n) && (state[k] & kFree) != 0) ? 1 : 0;
    });
    for_each([&](int m, int n, std::size_t k) {
        if (!is_border(m, n)) return;
        flood(e, static_cast<std::uint32_t>(k), 1, Connected::at_sides, queue,
              [&](std::size_t at) { return wide[at] != 0 && std::exchange(reached[at], std::uint8_t{1}) == 0; });
    });
    for_each([&](int m, int n, std::size_t k) {
        if ((state[k] & kFree) == 0) return;
        e.for_each_around(m, n, 1, [&](int x, int y) {
            if (wide[e.index(x, y)] != 0 && reached[e.index(x, y)] != 0) reached[k] = 1;
        });
    });
    return reached;
}

TEST(RimByLenslets, marks_and_tells_the_same) {
    std::mt19937_64 random(3);
    int with_part = 0, across_blocks = 0;
    for (int round = 0; round < 400; ++round) {
        const Field f = random_field(random);
        const Extents& e = f.e;
        const int margin = round % 7 == 0 ? 40 : static_cast<int>(random() % 6);
        RimFinder finder(e, margin);
        std::vector<std::uint8_t> mask = f.mask;
        finder.mark(f.deflections, f.sums, mask);
        const FoundPart& found = finder.found();
        const auto state = found.state;
        const auto part = [&](std::size_t k) { return (state[k] & kPart) != 0; };
        const auto inside = [&](std::size_t k) { return (state[k] & kInside) != 0; };
        SCOPED_TRACE(::testing::Message() << "round " << round << ": " << e.m << "x" << e.n << ", margin " << margin);

        const std::vector<std::uint8_t> reached = reached_in(e, state);
        std::size_t area = 0, steps = 0, sharp = 0, judged = 0, free = 0, n_sum = 0, m_sum = 0, all_inside = 0,
                    both = 0;
        const auto step = [&](std::size_t a, std::size_t b) {
            if (!((part(a) && !inside(b)) || (part(b) && !inside(a)))) return;
            ++steps;
            sharp += jumps({f.deflections, f.sums, mask}, a, b) ? 1 : 0;
        };
        std::vector<int> beside(static_cast<std::size_t>(e.m + e.n)), free_beside(beside.size());
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const std::size_t k = e.index(m, n);
                if (found.free_light) {
                    ASSERT_EQ((state[k] & kReached) != 0, reached[k] != 0) << m << ", " << n;
                    ASSERT_NE((state[k] & kReached) != 0, (state[k] & kUnreached) != 0);
                }
                area += part(k) ? 1 : 0;
                if (m + 1 < e.m) step(k, e.index(m + 1, n));
                if (n + 1 < e.n) step(k, e.index(m, n + 1));
                // The rim: the window around the lenslet leaves the field, or has lenslets of the part and others.
                bool leaves = m < margin || n < margin || m >= e.m - margin || n >= e.n - margin, any = false,
                     other = false;
                e.for_each_around(m, n, margin, [&](int x, int y) { (inside(e.index(x, y)) ? any : other) = true; });
                const int expected = !inside(k) ? kOutside : leaves || (any && other) ? kRim : kValid;
                ASSERT_EQ(mask[k] & kNotJudged, expected) << m << ", " << n;
                if ((mask[k] & kNotJudged) == 0) {
                    ++judged;
                    free += (state[k] & kFree) != 0 ? 1 : 0;
                }
                for (const int line : {m, e.m + n}) {
                    if (inside(k)) continue;
                    ++beside[static_cast<std::size_t>(line)];
                    free_beside[static_cast<std::size_t>(line)] += (state[k] & kReached) != 0 ? 1 : 0;
                }
                if (!inside(k)) continue;
                ++all_inside;
                m_sum += static_cast<std::size_t>(m), n_sum += static_cast<std::size_t>(n);
            }
        }
        if (found.parts == 0) continue;
        ++with_part;
        across_blocks += e.m > 64 ? 1 : 0;
        const auto twice = [&](std::size_t sum) {
            return static_cast<int>(
                divide_rounded(2 * static_cast<std::int64_t>(sum), static_cast<std::int64_t>(all_inside)));
        };
        double least = 1;
        for (std::size_t line = 0; line < beside.size(); ++line) {
            if (free_beside[line] == 0) least = 0;
            else if (beside[line] >= kMinBeside)
                least = std::min(least, static_cast<double>(free_beside[line]) / beside[line]);
        }
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const int x = twice(m_sum) - m, y = twice(n_sum) - n;
                const bool in_field = x >= 0 && y >= 0 && x < e.m && y < e.n;
                both += in_field && inside(e.index(m, n)) && inside(e.index(x, y)) ? 1 : 0;
            }
        }
        EXPECT_EQ(found.area, area);
        EXPECT_EQ(found.sharp_outline, steps == 0 ? 0 : static_cast<double>(sharp) / static_cast<double>(steps));
        EXPECT_EQ(found.free_beside, least);
        EXPECT_EQ(found.symmetry, static_cast<double>(both) / static_cast<double>(2 * all_inside - both));
        EXPECT_EQ(found.deflecting, judged == 0 ? 1 : 1 - static_cast<double>(free) / static_cast<double>(judged));
    }
    EXPECT_GT(with_part, 100);
    EXPECT_GT(across_blocks, 50);
}

}  // namespace
}  // namespace hord::algo
