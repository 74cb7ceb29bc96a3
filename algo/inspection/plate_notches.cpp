// RimFinder: places at a plate's outline where the light outside goes on inside, and no edge is seen.
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/statistics.h"

namespace hord::algo {

using namespace outline;

namespace {
constexpr int kMinBesideNotch = 2, kMaxBesideNotch = 4;  // lenslets of free light outside
constexpr int kMinLines = 8;                             // of a side of the plate
constexpr std::size_t kMinOpen = 2;                      // lines of a notch
constexpr double kSigmas = 5;

// Mean light of the lenslets from `from` on, up to `most` of them, while they count; 0 if fewer than `least` do.
template <class Counts>
double mean_light(const FieldLight& light, std::size_t from, std::ptrdiff_t step, int available, int least, int most,
                  Counts&& counts) {
    double sum = 0;
    int count = 0;
    for (; count < std::min(available, most) && counts(from); ++count) {
        sum += light.sums[from];
        from += static_cast<std::size_t>(step);
    }
    return count < least ? 0.0 : sum / count;
}

}  // namespace

// The lines that cross an edge of the plate at 45 degrees or more, side by side: rows at its left and right, columns at
// its top and bottom. Where a line shows undeflected light in all lenslets of the rim and none of an edge, the mean of
// this light is compared with the free light outside. Behind the edges of the other lines the plate takes a share of
// the light. Two lines or more beside each other in which less than half of it is taken, by five standard errors, are a
// notch. The noise is that of all sides: a side alone has few lines.
bool RimFinder::has_notch(const FieldLight& light, int depth) {
    const int m = extents_.m, n = extents_.n;
    const std::size_t last_column = extents_.index(m - 1, 0), last_row = extents_.index(0, n - 1);
    const std::ptrdiff_t right = 1, down = m;
    open_lines_.clear();
    deviations_.clear();
    std::array<ComparedSide, 4> compared;
    std::size_t sides = 0;
    for (const FieldSide& side : {FieldSide{n, m, 0, down, right}, FieldSide{n, m, last_column, down, -right},
                                  FieldSide{m, n, 0, right, down}, FieldSide{m, n, last_row, right, -down}}) {
        const ComparedSide lines = compare_lines(light, side, depth);
        if (lines.first < lines.end) compared[sides++] = lines;
    }
    if (sides == 0) return false;
    // Of a normal distribution, by the median of absolute values; of the mean of `depth` lenslets instead of four.
    const double sigma = 1.4826 * common::lower_median(std::span(deviations_)) *
        std::sqrt((1.0 / depth + 1.0 / kMaxBesideNotch) / (2.0 / kMaxBesideNotch));
    return std::any_of(compared.begin(), compared.begin() + static_cast<std::ptrdiff_t>(sides),
                       [&](const ComparedSide& lines) { return shows_notch(lines, sigma); });
}

// Adds to open_lines_ what the light in the rim of each line is of the free light outside it (0: an edge is seen, or
// the line cannot be told), and to deviations_ how far the same behind the rim lies from its median. No lines if few
// can be compared.
RimFinder::ComparedSide RimFinder::compare_lines(const FieldLight& light, const FieldSide& side, int depth) {
    const NearFree near_free(free_);
    const auto is_clear = [&](std::size_t k) {
        return (light.mask[k] & kNoHord) == 0 && near_free.has(light.deflections[k]);
    };
    first_of_line_.assign(static_cast<std::size_t>(side.lines) + 4, -1);  // two more on either side
    int* const first_of = first_of_line_.data() + 2;
    for (int line = 0; line < side.lines; ++line) {
        int first = 0;
        while (first < side.length && (state_[side.at(line, first)] & kPart) == 0) ++first;
        first_of[line] = first < side.length ? first : -1;
    }
    ComparedSide compared{.first = open_lines_.size()};
    open_lines_.resize(compared.first + static_cast<std::size_t>(side.lines), 0);
    glass_lines_.clear();
    const int into = 2 * default_rim_margin(extents_) + 2;
    for (int line = 0; line < side.lines; ++line) {
        const int first = first_of[line], before = first_of[line - 2], behind = first_of[line + 2];
        if (first < 0 || before < 0 || behind < 0 || std::abs(behind - before) > 4) continue;
        const double beside = mean_light(light, side.at(line, first - 2), -side.inwards, first - 1, kMinBesideNotch,
                                         kMaxBesideNotch, [&](std::size_t k) { return (state_[k] & kReached) != 0; });
        if (beside <= 0) continue;
        const int left = side.length - first;
        open_lines_[compared.first + static_cast<std::size_t>(line)] =
            mean_light(light, side.at(line, first), side.inwards, left, depth, depth, is_clear) / beside;
        const double inside =
            mean_light(light, side.at(line, first + into), side.inwards, left - into, kMaxBesideNotch, kMaxBesideNotch,
                       [&](std::size_t k) { return is_clear(k) && (state_[k] & kPart) != 0; });
        if (inside > 0) glass_lines_.push_back(inside / beside);
    }
    if (static_cast<int>(glass_lines_.size()) < kMinLines) {
        open_lines_.resize(compared.first);
        return {};
    }
    compared.end = open_lines_.size();
    compared.through = common::lower_median(std::span(glass_lines_));
    for (const double value : glass_lines_) deviations_.push_back(std::abs(value - compared.through));
    return compared;
}

// `sigma`: of a line.
bool RimFinder::shows_notch(const ComparedSide& lines, double sigma) const {
    for (std::size_t from = lines.first; from < lines.end; ++from) {
        double sum = 0;
        for (std::size_t to = from; to < lines.end && open_lines_[to] > 0; ++to) {
            sum += open_lines_[to];
            const std::size_t count = to - from + 1;
            const double excess = sum / static_cast<double>(count) - lines.through;
            if (count >= kMinOpen && excess > (1 - lines.through) / 2 &&
                excess > kSigmas * sigma / std::sqrt(static_cast<double>(count)))
                return true;
        }
    }
    return false;
}

}  // namespace hord::algo
