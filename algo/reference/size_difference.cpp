#include "algo/reference/size_difference.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "algo/frame/mask.h"
#include "algo/reference/edge_agreement.h"
#include "algo/reference/map_reader.h"

namespace hord::algo {
namespace {

constexpr int kReach = 2;                // as that of edge_agreement.cpp
constexpr double kFarthestEdge = 3;      // lenslets that an edge may lie from the reference's
constexpr double kCoarse = 0.5;          // of the search; halved until kFine
constexpr std::size_t kCoarsely = 4;     // of as many places one
constexpr double kFine = 0.125;          // lenslets; a parabola tells the rest
constexpr std::size_t kMaxPlaces = 256;  // of both sides, about
constexpr std::size_t kMinSizes = 8;
constexpr double kLimitNoises = 3.9;  // standard deviations of a normal variable that one of 10,000 exceeds

// Lenslets of the part where the reference has edges, on one side of the part.
struct Place {
    double m, n;   // in the reference
    double value;  // the part's light over the typical light
};

struct Side {
    double offset = 0, variance = 0;  // lenslets, in the direction of the axis
};

class SideFinder {
  public:
    SideFinder(const Extents& extents, const ReferenceMaps& reference, std::size_t axis, double typical)
        : reader_(extents, reference.mask), light_(reference.light), axis_(axis), typical_(typical) {}

    std::optional<Side> find(std::span<const Place> places);

  private:
    struct Cost {
        double sum = 0;  // the mean square
        std::size_t near = 0, count = 0;
    };
    [[nodiscard]] Cost cost(double offset, std::span<const Place> places, std::size_t every = 1);

    CubicReader reader_;
    std::span<const float> light_;
    std::size_t axis_;
    double typical_;
};

// Mean square difference from the reference moved by `offset`, of every `every`-th place.
SideFinder::Cost SideFinder::cost(double offset, std::span<const Place> places, std::size_t every) {
    Cost result;
    for (std::size_t k = 0; k < places.size(); k += every) {
        const Place& place = places[k];
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
std::optional<Side> SideFinder::find(std::span<const Place> places) {
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

// Calls `each(m, n)` for the lenslets around which the reference's light changes across the axis as at an edge.
template <class Each>
void for_each_edge(const Extents& extents, const ReferenceMaps& reference, std::size_t axis, double typical,
                   Each&& each) {
    const auto apart = axis == 0 ? std::ptrdiff_t{1} : std::ptrdiff_t{extents.m};
    for (int n = kReach; n + kReach < extents.n; ++n) {
        for (int m = kReach; m + kReach < extents.m; ++m) {
            const float* at = reference.light.data() + extents.index(m, n);
            float least = *at, most = *at;
            for (std::ptrdiff_t k = -kReach; k <= kReach; ++k)
                least = std::min(least, at[k * apart]), most = std::max(most, at[k * apart]);
            if (static_cast<double>(most - least) > kForeignLight * typical) each(m, n);
        }
    }
}

// Chooses a share of the lenslets of any line evenly: multiples of the golden ratio lie evenly in 0..1.
struct Chooser {
    std::size_t of, seen = 0;
    bool next() { return seen++ * 1597 % 2584 * of < 2584 * kMaxPlaces; }
};

// The places at edges across one axis, before and behind their middle.
struct Places {
    std::array<std::array<Place, kMaxPlaces>, 2> of;
    std::array<std::size_t, 2> count{};
    [[nodiscard]] std::span<const Place> side(std::size_t which) const {
        return std::span(of[which]).first(count[which]);
    }
};

// About kMaxPlaces, evenly over all edges; false if the edges are so few that they are specks.
bool collect(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
             std::size_t axis, double typical, double light, Places& places) {
    std::size_t edges = 0;
    double sum = 0;
    const auto along = [&](int m, int n) { return axis == 0 ? m : n; };
    for_each_edge(extents, reference, axis, typical, [&](int m, int n) { ++edges, sum += along(m, n); });
    if (2 * edges < static_cast<std::size_t>(extents.m + extents.n)) return false;
    const double middle = sum / static_cast<double>(edges);
    Chooser chooser{edges};
    for_each_edge(extents, reference, axis, typical, [&](int m, int n) {
        if (!chooser.next()) return;
        const auto p = map.to_part(m, n);
        const int at_m = floor_of(p.m + 0.5), at_n = floor_of(p.n + 0.5);
        if (at_m < 0 || at_n < 0 || at_m >= extents.m || at_n >= extents.n) return;
        const std::size_t at = extents.index(at_m, at_n), which = along(m, n) < middle ? 0 : 1;
        if ((part.mask[at] & kSaturated) != 0 || places.count[which] == kMaxPlaces) return;
        const auto q = map.to_reference(at_m, at_n);
        places.of[which][places.count[which]++] = {q.m, q.n, static_cast<double>(part.sums[at]) / (light * typical)};
    });
    return true;
}

}  // namespace

SizeDifference compare_sizes(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                             const PoseMap& map, double typical, double light) {
    SizeDifference result;
    for (const std::size_t axis : {0U, 1U}) {
        Places places;
        if (!collect(extents, reference, part, map, axis, typical, light, places)) continue;
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
        if (parts_[axis] < kMinSizes) continue;
        // Student's t of 1 in 10,000 on both sides together, by its expansion in 1 / degrees of freedom (Abramowitz and
        // Stegun, 26.7.5); from 7 degrees on right to 3 %.
        const auto parts = static_cast<double>(parts_[axis]);
        const double v = 1 / (parts - 1), t = kLimitNoises + v * (15.7 + v * (56.4 + v * 152));
        limits[axis] = static_cast<float>(t * std::sqrt(squares_[axis] / parts));
    }
    return limits;
}

}  // namespace hord::algo
