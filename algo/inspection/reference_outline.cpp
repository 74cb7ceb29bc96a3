#include "algo/inspection/reference_outline.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/inspection/rim.h"
#include "algo/reference/reference.h"

namespace hord::algo {

// By the rule for frames. Lenslets that the reference does not know, at the field's border, count as the next one that
// it knows on the way to the middle.
ReferenceOutline::ReferenceOutline(const Recipe& recipe, const Extents& e) : extents_(e), outline_(e.lenslets()) {
    const Reference& r = *recipe.reference;
    std::vector<Deflection> deflections(e.lenslets());
    std::vector<std::uint32_t> sums(e.lenslets());
    const auto bins = [](float v) {
        return DeflectionQ::from_raw(std::llround(static_cast<double>(v) * (1 << DeflectionQ::kFractionBits)));
    };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t to = e.index(m, n);
            std::size_t from = to;
            for (int inwards = 1; (r.mask[from] & kOutside) != 0 && 2 * inwards < std::min(e.m, e.n); ++inwards)
                from = e.index(std::clamp(m, inwards, e.m - 1 - inwards), std::clamp(n, inwards, e.n - 1 - inwards));
            deflections[to] = {bins(r.x[from]), bins(r.y[from])};
            sums[to] = static_cast<std::uint32_t>(std::lround(r.light[from]));
            outline_[to] = (r.mask[from] & (kOutside | kDark)) != 0 ? kDark : kValid;
        }
    }
    RimFinder::of(recipe, e).mark(deflections, sums, outline_);
    for (std::uint8_t& bits : outline_) bits &= kNotJudged;
}

void ReferenceOutline::take_in(const PoseMap& pose, std::span<const std::uint8_t> zones, std::span<std::uint8_t> mask,
                               int first, int last) const {
    std::size_t k = extents_.index(0, first);
    for (int n = first; n < last; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            if ((mask[k] & kOutside) == 0 || (zones[k] & kOutside) != 0) continue;
            const PoseMap::Place q = pose.to_reference(m, n);
            const int column = floor_of(q.m + 0.5), row = floor_of(q.n + 0.5);
            if (column < 0 || row < 0 || column >= extents_.m || row >= extents_.n) continue;
            if (outline_[extents_.index(column, row)] == kValid) mask[k] &= static_cast<std::uint8_t>(~kOutside);
        }
    }
}

}  // namespace hord::algo
