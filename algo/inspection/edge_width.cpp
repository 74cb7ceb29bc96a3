// RimFinder: how sharp the part's outline is.
#include <algorithm>
#include <array>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

// At both ends of the part in each row and each column: the lenslets that show undeflected light of a fifth to four
// fifths of the free light beside them. An edge in focus covers one lenslet in part, or two if it lies askew. An edge
// that moved, or was exposed twice, is as wide as it moved. The median of the rows, or of the columns if it is wider;
// of a tube only across its axis, because its ends are as deep as it is wide.
int RimFinder::edge_width(const FieldLight& light) const {
    constexpr int kWidest = 15;      // wider ones count so
    constexpr int kFreeBeside = 12;  // lenslets outside the part, the brightest of which is the free light
    constexpr int kMinFree = 3;      // of these, that show free light
    const NearFree near_free(free_);
    std::array<int, kWidest + 1> edges{};  // of so many lenslets
    struct Median {
        int edges = 0, width = 0;
    };
    // `step`: from the field towards the part. `outside`, `inside`: lenslets of the line before the part, and of it.
    const auto take = [&](std::size_t first, std::ptrdiff_t step, int outside, int inside) {
        const auto at = [&](int in) { return first + static_cast<std::size_t>(step * in); };
        std::uint32_t free = 0;
        int count = 0;
        for (int k = 1; k <= std::min(outside, kFreeBeside); ++k) {
            if ((state_[at(-k)] & kReached) == 0) continue;
            free = std::max(free, light.sums[at(-k)]);
            ++count;
        }
        if (count < kMinFree) return;
        const auto is_partial = [&](int in) {
            const std::size_t k = at(in);
            return (light.mask[k] & kDark) == 0 && near_free.has(light.deflections[k]) &&
                std::uint64_t{5} * light.sums[k] > free && std::uint64_t{5} * light.sums[k] < std::uint64_t{4} * free;
        };
        int before = 0, behind = 0;
        while (before < outside && is_partial(-1 - before)) ++before;
        while (behind < inside && is_partial(behind)) ++behind;
        ++edges[static_cast<std::size_t>(std::min(before + behind, kWidest))];
    };
    const auto median_of = [&](int lines, int length, auto&& index) {
        edges.fill(0);
        const auto step = static_cast<std::ptrdiff_t>(index(0, 1) - index(0, 0));
        for (int line = 0; line < lines; ++line) {
            const auto is_part = [&](int k) { return (state_[index(line, k)] & kPart) != 0; };
            int first = 0, last = length - 1;
            while (first < length && !is_part(first)) ++first;
            while (last > first && !is_part(last)) --last;
            if (first >= last) continue;
            take(index(line, first), step, first, last - first + 1);
            take(index(line, last), -step, length - 1 - last, last - first + 1);
        }
        int all = 0, seen = 0, width = 0;
        for (const int count : edges) all += count;
        if (all < kMinBeside) return Median{};
        while (2 * (seen += edges[static_cast<std::size_t>(width)]) < all) ++width;
        return Median{all, width};
    };
    const auto in_rows = [&] {
        return median_of(extents_.n, extents_.m, [&](int n, int m) { return extents_.index(m, n); });
    };
    const auto in_columns = [&] {
        return median_of(extents_.m, extents_.n, [&](int m, int n) { return extents_.index(m, n); });
    };
    if (tube_) return (tube_->along_columns() ? in_rows() : in_columns()).width;
    const Median rows = in_rows(), columns = in_columns();
    // Few lines of an axis are those along an edge that is a little askew, as of a plate from border to border.
    return std::max(2 * rows.edges >= columns.edges ? rows.width : 0,
                    2 * columns.edges >= rows.edges ? columns.width : 0);
}

}  // namespace hord::algo
