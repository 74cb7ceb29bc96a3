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
}  // namespace

// The lines that cross an edge of the plate at 45 degrees or more, side by side: rows at its left and right, columns at
// its top and bottom. Where a line shows undeflected light in all lenslets of the rim and none of an edge, the mean of
// this light is compared with the free light outside. Behind the edges of the other lines the plate takes a share of
// the light. Two lines or more beside each other in which less than half of it is taken, by five standard errors, are a
// notch.
bool RimFinder::has_notch(const FieldLight& light, int depth) {
    const NearFree near_free(free_);
    const auto is_clear = [&](std::size_t k) {
        return (light.mask[k] & kNoHord) == 0 && near_free.has(light.deflections[k]);
    };
    const auto mean = [&](std::size_t from, std::ptrdiff_t step, int available, int least, int most, auto&& counts) {
        double sum = 0;
        int count = 0;
        for (; count < std::min(available, most) && counts(from); ++count) {
            sum += light.sums[from];
            from += static_cast<std::size_t>(step);
        }
        return count < least ? 0.0 : sum / count;
    };
    const auto side = [&](int lines, int length, auto&& index) {
        auto &open = open_lines_, &glass = glass_lines_, &sorted = sorted_lines_;
        const auto step = static_cast<std::ptrdiff_t>(index(0, 1)) - static_cast<std::ptrdiff_t>(index(0, 0));
        first_of_line_.assign(static_cast<std::size_t>(lines) + 4, -1);  // two more on either side
        int* const first_of = first_of_line_.data() + 2;
        for (int line = 0; line < lines; ++line) {
            int first = 0;
            while (first < length && (state_[index(line, first)] & kPart) == 0) ++first;
            first_of[line] = first < length ? first : -1;
        }
        open.assign(static_cast<std::size_t>(lines), 0);
        glass.clear();
        for (int line = 0; line < lines; ++line) {
            const int first = first_of[line], before = first_of[line - 2], behind = first_of[line + 2];
            if (first < 0 || before < 0 || behind < 0 || std::abs(behind - before) > 4) continue;
            const double beside =
                mean(index(line, first) - static_cast<std::size_t>(2 * step), -step, first - 1, kMinBesideNotch,
                     kMaxBesideNotch, [&](std::size_t k) { return (state_[k] & kReached) != 0; });
            if (beside <= 0) continue;
            open[static_cast<std::size_t>(line)] =
                mean(index(line, first), step, length - first, depth, depth, is_clear) / beside;
            const int into = 2 * default_rim_margin(extents_) + 2;
            const double inside = mean(index(line, first) + static_cast<std::size_t>(into * step), step,
                                       length - first - into, kMaxBesideNotch, kMaxBesideNotch,
                                       [&](std::size_t k) { return is_clear(k) && (state_[k] & kPart) != 0; });
            if (inside > 0) glass.push_back(inside / beside);
        }
        if (static_cast<int>(glass.size()) < kMinLines) return false;
        sorted = glass;
        const double through = common::lower_median(std::span(sorted));
        for (double& value : sorted) value = std::abs(value - through);
        // Of a normal distribution, by the median of absolute values; of the mean of `depth` lenslets instead of four.
        const double sigma = 1.4826 * common::lower_median(std::span(sorted)) *
            std::sqrt((1.0 / depth + 1.0 / kMaxBesideNotch) / (2.0 / kMaxBesideNotch));
        for (std::size_t from = 0; from < open.size(); ++from) {
            double sum = 0;
            for (std::size_t to = from; to < open.size() && open[to] > 0; ++to) {
                sum += open[to];
                const std::size_t count = to - from + 1;
                const double excess = sum / static_cast<double>(count) - through;
                if (count >= kMinOpen && excess > (1 - through) / 2 &&
                    excess > kSigmas * sigma / std::sqrt(static_cast<double>(count)))
                    return true;
            }
        }
        return false;
    };
    const int columns = extents_.m, rows = extents_.n;
    return side(rows, columns, [&](int n, int m) { return extents_.index(m, n); }) ||
        side(rows, columns, [&](int n, int m) { return extents_.index(columns - 1 - m, n); }) ||
        side(columns, rows, [&](int m, int n) { return extents_.index(m, n); }) ||
        side(columns, rows, [&](int m, int n) { return extents_.index(m, rows - 1 - n); });
}

}  // namespace hord::algo
