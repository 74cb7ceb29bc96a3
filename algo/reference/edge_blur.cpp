#include "algo/reference/edge_blur.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include "algo/frame/mask.h"
#include "algo/reference/edge_places.h"
#include "algo/reference/limit_of_parts.h"
#include "algo/reference/map_reader.h"

namespace hord::algo {
namespace {

// Where an edge lies in a lenslet, the parts learned may all have it alike. The mean over a lenslet, which frames show,
// widens it by the variance of a lenslet, 1/12, wherever it lies; the next part may show all or nothing of that.
constexpr double kOfAperture = 1.0 / 12;

// A place's light less the reference's, and what motion would change there.
struct Change {
    double ratio, by_motion, rest;
};

using Changes = std::array<Change, 2 * EdgePlaces::kMax>;

// The weighted median of the ratios: a piece that is missing at the outline changes few places, motion changes all.
double weighted_median(std::span<Change> changes, double weights) {
    std::ranges::sort(changes, {}, &Change::ratio);
    double seen = 0;
    for (const Change& change : changes) {
        seen += change.by_motion * change.by_motion;
        if (2 * seen >= weights) return change.ratio;
    }
    return 0;
}

}  // namespace

EdgeBlur compare_blur(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                      const SizeDifference& size, double typical, double light) {
    EdgeBlur result;
    CubicReader reader(extents, reference.mask);
    for (const std::size_t axis : {0U, 1U}) {
        EdgePlaces places;
        if (!places.collect(extents, reference, part, map, axis, typical, light)) continue;
        const auto light_at = [&](const EdgePlace& place, double aside) -> std::optional<double> {
            if (!reader.move_to(place.m + (axis == 0 ? aside : 0), place.n + (axis == 1 ? aside : 0)) ||
                (reader.mask() & (kOutside | kSaturated)) != 0)
                return std::nullopt;
            return reader.read(reference.light).value / typical;
        };
        Changes all;
        std::size_t count = 0;
        double weights = 0;
        for (const std::size_t side : {0U, 1U}) {
            const double offset = size.offset(axis, side);  // another size is no blur
            for (const EdgePlace& place : places.side(side)) {
                const auto before = light_at(place, -offset - 1), here = light_at(place, -offset),
                           behind = light_at(place, -offset + 1);
                if (!before || !here || !behind) continue;
                const double by_motion = 0.5 * (*before + *behind) - *here, rest = place.value - *here;
                if (by_motion == 0) continue;
                all[count++] = {rest / by_motion, by_motion, rest};
                weights += by_motion * by_motion;
            }
        }
        if (count == 0 || 2 * count < places.count[0] + places.count[1]) continue;
        const std::span<Change> changes = std::span(all).first(count);
        result.known[axis] = true;
        result.blur[axis] = weighted_median(changes, weights);
        double squares = 0;
        for (const Change& change : changes) {
            const double left = change.rest - result.blur[axis] * change.by_motion;
            squares += left * left;
        }
        result.noise[axis] = std::sqrt(squares / (static_cast<double>(count) * weights));
        const double limit = static_cast<double>(reference.blur_limits[axis]),
                     noise = kLimitNoises * result.noise[axis];
        result.allowed[axis] = limit > 0 ? std::sqrt(limit * limit + noise * noise) : 0;
    }
    return result;
}

void BlurSpread::add(const EdgeBlur& blur) {
    for (const std::size_t axis : {0U, 1U}) {
        if (!blur.known[axis]) continue;
        sums_[axis] += blur.blur[axis];
        squares_[axis] += blur.blur[axis] * blur.blur[axis];
        ++parts_[axis];
    }
}

std::array<float, 2> BlurSpread::limits() const {
    std::array<float, 2> limits{};
    for (const std::size_t axis : {0U, 1U}) {
        if (parts_[axis] < kMinLimited) continue;
        limits[axis] =
            static_cast<float>(std::max(limit_of_parts(sums_[axis], squares_[axis], parts_[axis]), kOfAperture));
    }
    return limits;
}

}  // namespace hord::algo
