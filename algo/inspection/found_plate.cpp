// RimFinder: what the frame checks ask of a plate: whether it takes light.
#include <algorithm>
#include <array>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/statistics.h"

namespace hord::algo {

using namespace outline;

// At each end of a row or column of the part: the mean of two to four lenslets of undeflected light on either side, the
// margin away from what the edge darkens or deflects. Tinted glass may leave less inside than counts as free light.
void RimFinder::compare_across_edges(const FieldLight& light) {
    constexpr int kMin = 2, kMax = 4;
    int steps = 0, shaded = 0;
    LightAcrossEdges all, inner;  // `inner`: of lines that lie inside the part beyond the edges along them
    const NearFree near_free(free_);
    const auto is_undeflected = [&](std::size_t k) {
        return (light.mask[k] & kDark) == 0 && near_free.has(light.deflections[k]);
    };
    const auto is_reached = [&](std::size_t k) { return (state_[k] & kReached) != 0; };
    const auto mean_light = [&](std::size_t from, std::ptrdiff_t step, int available, auto&& counts) {
        std::int64_t sum = 0;
        int count = 0;
        for (; count < std::min(available, kMax) && counts(from); ++count) {
            sum += light.sums[from];
            from += static_cast<std::size_t>(step);
        }
        return count < kMin ? 0.0 : static_cast<double>(sum) / count;
    };
    const auto is_part_or_beyond_field = [&](std::size_t k, std::ptrdiff_t beside) {
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m,
                  across = static_cast<int>(beside) % extents_.m, down = static_cast<int>(beside) / extents_.m;
        return m + across < 0 || m + across >= extents_.m || n + down < 0 || n + down >= extents_.n ||
            (state_[extents_.index(m + across, n + down)] & kPart) != 0;
    };
    // `outside`: lenslets of the line before the part's first one, `half`: of the part up to its middle. `to_next`:
    // from the line to the next one.
    const auto take = [&](std::size_t first, std::ptrdiff_t step, std::ptrdiff_t to_next, int outside, int half) {
        const auto at = [&](int steps_in) { return first + static_cast<std::size_t>(step * steps_in); };
        int edge = 0;
        while (edge < half && (state_[at(edge)] & kFree) == 0) ++edge;
        if (edge == half) {  // tinted
            for (edge = 0; edge < half && !is_undeflected(at(edge));) ++edge;
        }
        int reached = margin_;
        while (reached < outside && is_reached(at(-1 - reached))) ++reached;
        const double inside = mean_light(at(edge + margin_), step, half - edge - margin_, is_undeflected),
                     beside = mean_light(at(-1 - margin_), -step, reached - margin_, is_reached);
        if (inside <= 0 || beside <= 0) return;
        ++steps;
        shaded += inside < kShadedLight * beside ? 1 : 0;
        // As far from `beside` as `inside` is, if there is free light; the same lenslets in part, if there is little.
        const int across = edge + 2 * margin_ + 1, window = std::min(reached - margin_, kMax),
                  away = std::min(across, reached - margin_ - window);
        LightAcrossEdges line{.lines = 1,
                              .inside = inside,
                              .beside = beside,
                              .farther = mean_light(at(-1 - margin_ - away), -step, window, is_reached),
                              .farthest = mean_light(at(-reached), step, window, is_reached),
                              .across = across,
                              .away = away,
                              .apart = across + kMax - 1};
        const int into = std::min(across, half - edge - margin_ - kMax);
        const double deeper = into > 0 ? mean_light(at(edge + margin_ + into), step, kMax, is_undeflected) : 0;
        if (deeper > 0) {
            line.into = into;
            deviations_.push_back(inside - deeper);
        }
        all.add(line);
        const std::ptrdiff_t beside_line = to_next * (edge + margin_);
        const std::size_t middle = at(half - 1);
        if (is_part_or_beyond_field(middle, beside_line) && is_part_or_beyond_field(middle, -beside_line)) {
            inner.add(line);
            if (deeper > 0) glass_lines_.push_back(inside - deeper);
        }
    };
    const auto look_at = [&](std::size_t start, std::ptrdiff_t step, std::ptrdiff_t to_next, int length) {
        const auto is_part = [&](int k) { return (state_[start + static_cast<std::size_t>(step * k)] & kPart) != 0; };
        int first = 0, last = length - 1;
        while (first < length && !is_part(first)) ++first;
        while (last > first && !is_part(last)) --last;
        if (first >= last) return;
        const int half = (last - first + 1) / 2;
        take(start + static_cast<std::size_t>(step * first), step, to_next, first, half);
        take(start + static_cast<std::size_t>(step * last), -step, to_next, length - 1 - last, half);
    };
    deviations_.clear();
    glass_lines_.clear();
    for (int n = 0; n < extents_.n; ++n) look_at(extents_.index(0, n), 1, extents_.m, extents_.m);
    for (int m = 0; m < extents_.m; ++m) look_at(extents_.index(m, 0), extents_.m, 1, extents_.n);
    found_.shaded_steps = steps;
    if (steps == 0) return;
    found_.shaded = static_cast<double>(shaded) / steps;
    found_.light_beside = all.beside / all.lines;
    const bool few = inner.lines < kMinShadedSteps;
    LightAcrossEdges& sums = few ? all : inner;
    // The median: a spot in the middle of a plate makes light fall in the lines through it alone, a lamp in all.
    std::vector<double>& fallen = few ? deviations_ : glass_lines_;
    if (!fallen.empty()) sums.fallen = common::lower_median(std::span(fallen)) * static_cast<double>(fallen.size());
    found_.soft_shadow = is_shadow(sums, sums.lines * light_at_centroid(light));
    found_.clear_middle = found_.soft_shadow && !is_shadow(sums, 0);
}

void RimFinder::LightAcrossEdges::add(const LightAcrossEdges& line) {
    lines += line.lines;
    inside += line.inside, beside += line.beside, farther += line.farther, farthest += line.farthest;
    across += line.across, away += line.away, apart += line.apart, into += line.into;
}

// The light grows away from the edges outside, or falls on inside: a shadow about a hair or a frame, or a lamp that is
// darker in the middle. Then what it changes there goes on across the edges, and the middle of a shadow may be as light
// as the field. A lamp changes across the edges by the mean of what it changes by on both sides.
bool RimFinder::is_shadow(const LightAcrossEdges& sums, double middle) {
    const auto carried_on = [](double change, int from, int to) {
        return from > 0 ? change * std::min(static_cast<double>(to) / from, kFarthestExtrapolated) : 0;
    };
    const double outside = sums.farther - sums.beside,
                 change = std::max(
                     carried_on(outside, sums.away, sums.across),
                     (carried_on(outside, sums.away, sums.apart) + carried_on(sums.fallen, sums.into, sums.apart)) / 2);
    if (change <= 0) return false;
    const double lost = std::min(sums.beside - sums.inside, sums.farthest - middle);
    return lost - kSmoothChange * change <= (1 - kShadedLight) * sums.beside;
}

// Median of the undeflected lenslets among the 5x5 about the centroid of the part, with what it encloses; 0: none.
double RimFinder::light_at_centroid(const FieldLight& light) const {
    const Centroid middle = centroid();
    if (middle.area == 0) return 0;
    const NearFree near_free(free_);
    std::array<std::int64_t, 25> values{};
    std::size_t count = 0;
    extents_.for_each_around(middle.twice_m / 2, middle.twice_n / 2, 2, [&](int m, int n) {
        const std::size_t k = extents_.index(m, n);
        const bool undeflected = (light.mask[k] & kDark) == 0 && near_free.has(light.deflections[k]);
        if (undeflected) values[count++] = std::int64_t{light.sums[k]};
    });
    return count == 0 ? 0 : static_cast<double>(common::lower_median(std::span(values).first(count)));
}

}  // namespace hord::algo
