#include "algo/reference/size_difference.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "algo/frame/mask.h"
#include "algo/reference/edge_agreement.h"
#include "algo/reference/edge_places.h"
#include "algo/reference/limit_of_parts.h"
#include "algo/reference/map_reader.h"

namespace hord::algo {
namespace {

constexpr double kFarthestEdge = 3;   // lenslets that an edge may lie from the reference's
constexpr double kCoarse = 0.5;       // of the search; halved until kFine
constexpr std::size_t kCoarsely = 4;  // of as many places one
constexpr double kFine = 0.125;       // lenslets; a parabola tells the rest

struct Side {
    double offset = 0, variance = 0;  // lenslets, in the direction of the axis
};

class SideFinder {
  public:
    SideFinder(const Extents& extents, const ReferenceMaps& reference, std::size_t axis, double typical)
        : reader_(extents, reference.mask), light_(reference.light), axis_(axis), typical_(typical) {}

    std::optional<Side> find(std::span<const EdgePlace> places);

  private:
    struct Cost {
        double sum = 0;  // the mean square
        std::size_t near = 0, count = 0;
    };
    [[nodiscard]] Cost cost(double offset, std::span<const EdgePlace> places, std::size_t every = 1);

    CubicReader reader_;
    std::span<const float> light_;
    std::size_t axis_;
    double typical_;
};

// Mean square difference from the reference moved by `offset`, of every `every`-th place.
SideFinder::Cost SideFinder::cost(double offset, std::span<const EdgePlace> places, std::size_t every) {
    Cost result;
    for (std::size_t k = 0; k < places.size(); k += every) {
        const EdgePlace& place = places[k];
        const bool inside = reader_.move_to(place.m - (axis_ == 0 ? offset : 0), place.n - (axis_ == 1 ? offset : 0));
        if (!inside || (reader_.mask() & (kOutside | kSaturated)) != 0) continue;
        const double r = place.value - reader_.read(light_).value / typical_, square = r * r;
        ++result.count;
        result.near += square < kForeignLight * kForeignLight ? 1 : 0;
        result.sum += square;
    }
    if (2 * every * result.count < places.size()) result.sum = std::numeric_limits<double>::infinity();
    else result.sum /= static_cast<double>(result.count);
    return result;
}

// The offset at which the part's edge looks most like the reference's; none if half of it looks like that nowhere.
std::optional<Side> SideFinder::find(std::span<const EdgePlace> places) {
    double at = 0;
    Cost best = cost(0, places, kCoarsely);
    const auto consider = [&](double offset, std::size_t every) {
        if (const Cost other = cost(offset, places, every); other.sum < best.sum) best = other, at = offset;
    };
    for (double offset = kCoarse; offset <= kFarthestEdge; offset += kCoarse)
        consider(-offset, kCoarsely), consider(offset, kCoarsely);
    best = cost(at, places);
    for (double step = 0.5 * kCoarse; step >= kFine; step *= 0.5) {
        const double middle = at;
        consider(middle - step, 1), consider(middle + step, 1);
    }
    if (2 * best.near < best.count) return std::nullopt;
    const double before = cost(at - kFine, places).sum, behind = cost(at + kFine, places).sum,
                 bend = before + behind - 2 * best.sum;
    if (!(bend > 0) || !std::isfinite(bend)) return std::nullopt;
    const double moved = std::clamp(0.5 * (before - behind) / bend, -1.0, 1.0) * kFine;
    // The second derivative of the mean square is twice the mean square of the slopes.
    const double slopes = 0.5 * bend / (kFine * kFine);
    return Side{at + moved, best.sum / (slopes * static_cast<double>(best.count))};
}

}  // namespace

SizeDifference compare_sizes(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                             const PoseMap& map, double typical, double light) {
    SizeDifference result;
    for (const std::size_t axis : {0U, 1U}) {
        EdgePlaces places;
        if (!places.collect(extents, reference, part, map, axis, typical, light)) continue;
        SideFinder finder(extents, reference, axis, typical);
        const auto before = finder.find(places.side(0)), behind = finder.find(places.side(1));
        if (!before || !behind) continue;
        result.known[axis] = true;
        result.wider[axis] = behind->offset - before->offset;
        result.shift[axis] = 0.5 * (before->offset + behind->offset);
        result.apart[axis] = std::max(std::abs(before->offset), std::abs(behind->offset));
        const auto limit = static_cast<double>(reference.size_limits[axis]);
        const double noise = kLimitNoises * kLimitNoises * (before->variance + behind->variance);
        result.allowed[axis] = limit > 0 ? std::sqrt(limit * limit + noise) : 0;
    }
    return result;
}

void SizeSpread::add(const SizeDifference& size) {
    for (const std::size_t axis : {0U, 1U}) {
        if (!size.known[axis]) continue;
        squares_[axis] += size.wider[axis] * size.wider[axis];
        ++parts_[axis];
    }
}

std::array<float, 2> SizeSpread::limits() const {
    std::array<float, 2> limits{};
    for (const std::size_t axis : {0U, 1U}) {
        if (parts_[axis] < kMinLimited) continue;
        const auto parts = static_cast<double>(parts_[axis]);
        limits[axis] = static_cast<float>(t_of_limit(parts - 1) * std::sqrt(squares_[axis] / parts));
    }
    return limits;
}

}  // namespace hord::algo
