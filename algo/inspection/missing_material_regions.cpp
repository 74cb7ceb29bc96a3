// MissingMaterialFinder: bright squares that touch, and which of these regions have the outline of a hole.
#include <algorithm>
#include <array>
#include <cstdlib>

#include "algo/inspection/missing_material.h"
#include "algo/inspection/rim.h"

namespace hord::algo {
namespace {

constexpr int kSharpOf = 4, kSharp = 3;  // of the outline of a region leads down: 3/4
constexpr float kGoesOnOf = 4;           // at most 1/4 of the change across the outline goes on beyond

}  // namespace

// Takes the bright squares that touch `seed` as one region: their excess becomes negative. It is the best one if its
// score is the largest yet, and its outline that of a hole.
void MissingMaterialFinder::take_region(const Squares& squares, std::size_t seed, MissingMaterial& best) {
    const Level& level = *squares.level;
    const auto stride = static_cast<std::ptrdiff_t>(level.stride);
    const std::array<std::ptrdiff_t, 4> ways{1, -1, stride, -stride};  // by Direction
    Region region;
    const auto add = [&](std::size_t at) {
        region.most = std::max(region.most, excess_[at]);
        excess_[at] = -excess_[at];
        region_[region.squares++] = static_cast<std::uint32_t>(at);
        region.light += mean_[at];
        const auto [n, m] = std::div(static_cast<int>(at), static_cast<int>(level.stride));
        region.left = std::min(region.left, m), region.right = std::max(region.right, m);
        region.top = std::min(region.top, n), region.bottom = std::max(region.bottom, n);
        region.sum_m += m, region.sum_n += n;
    };
    add(seed);
    for (std::size_t q = 0; q < region.squares; ++q) {
        for (const std::ptrdiff_t way : ways) {
            const std::size_t next = beside(region_[q], way);
            if (excess_[next] > 0) add(next);
        }
    }
    if (region.most <= squares.limit * best.score || !is_sharp(squares, region) || is_part(squares, region)) return;
    if (squares.is_trial) {
        for (const std::uint32_t at : std::span(region_).first(region.squares)) of_hole_[at] = 1;
        return;
    }
    const auto middle = [&](double sum) {
        const double block = sum / static_cast<double>(region.squares) - kPad + 0.5;
        return static_cast<float>(block * level.block - 0.5);
    };
    const auto lenslets = [&](int blocks) { return std::max(blocks * level.block, squares.side()); };
    const auto wide = static_cast<float>(lenslets(region.right - region.left + 1)),
               high = static_cast<float>(lenslets(region.bottom - region.top + 1));
    const std::size_t area = std::max(region.squares * static_cast<std::size_t>(level.block * level.block),
                                      static_cast<std::size_t>(squares.side() * squares.side()));
    if (area < squares.sought.min_area) return;
    best = {.m = middle(region.sum_m),
            .n = middle(region.sum_n),
            .area = static_cast<std::uint32_t>(area),
            .length = std::max(wide, high),
            .width = std::min(wide, high),
            .excess = region.most,
            .score = region.most / squares.limit};
}

// Most steps out of the region lead down, to light that goes on no farther down; and it is no bump that smaller squares
// would have shown if it were a hole.
bool MissingMaterialFinder::is_sharp(const Squares& squares, const Region& region) const {
    const int distance = squares.distance();
    const auto stride = static_cast<std::ptrdiff_t>(squares.level->stride);
    const std::array<std::ptrdiff_t, 4> ways{1, -1, stride, -stride};
    const auto largest_bump = static_cast<std::size_t>(4 * distance * distance);
    if (region.most > squares.seen_excess && region.squares < largest_bump) return false;
    int exits = 0, sharp = 0;
    float change = 0, farther_change = 0;
    for (const std::uint32_t at : std::span(region_).first(region.squares)) {
        for (const std::ptrdiff_t way : ways) {
            const std::size_t next = beside(at, way);
            if (excess_[next] < 0 || mean_[next] <= 0) continue;
            ++exits;
            // The largest change on the way out: the outline lies within the distance of two squares.
            float largest = 0, goes_on = 0;
            bool is_step = false;
            for (int back = 0; back <= distance; ++back) {
                const std::size_t from = beside(at, -back * way), to = beside(from, distance * way);
                const float here = mean_[from], beyond = mean_[to], farther = mean_[beside(to, distance * way)];
                if (beyond <= 0 || here - beyond <= largest) continue;
                largest = here - beyond;
                goes_on = farther > 0 ? beyond - farther : 0;
                is_step = is_step || here > (1 + squares.limit / 2) * beyond;
            }
            sharp += is_step ? 1 : 0;
            change += largest;
            farther_change += goes_on;
        }
    }
    return kSharpOf * sharp >= kSharp * exits && kGoesOnOf * farther_change <= change;
}

// What a dark rim or ring surrounds: most of the squares in and about the region are as bright. A web has no rim, and
// most of it may be torn off. What is as light as the field beside the part is no part: it takes no light.
bool MissingMaterialFinder::is_part(const Squares& squares, const Region& region) const {
    if (form_ == PartForm::web) return false;
    const int wide = region.right - region.left + 1, high = region.bottom - region.top + 1;
    const float light = region.light / static_cast<float>(region.squares), least = light / (1 + region.most / 2);
    const float beside = squares.sought.light_beside;
    if (beside > 0 && light >= static_cast<float>(kShadedLight) * beside) return false;
    std::size_t all = 0, bright = 0;
    for (int n = std::max(region.top - high, kPad); n <= std::min(region.bottom + high, squares.level->n - 1 + kPad);
         ++n) {
        const float* const row = mean_.data() + static_cast<std::size_t>(n) * squares.level->stride;
        for (int m = std::max(region.left - wide, kPad);
             m <= std::min(region.right + wide, squares.level->m - 1 + kPad); ++m) {
            all += row[m] > 0 ? 1 : 0;
            bright += row[m] > least ? 1 : 0;
        }
    }
    return 2 * bright > all;
}

}  // namespace hord::algo
