#include "algo/reference/step_lines.h"

#include <algorithm>
#include <optional>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kReach = StepLine::kReach, kFlat = StepLine::kFlat;
constexpr double kCertain = 6;            // standard deviations of the reference's noise in any of its lenslets
constexpr double kUneven = 0.25;          // of a step, that its levels may change by
constexpr double kMaxSlant = 1;           // lenslets a line: else it is one across the other axis
constexpr std::size_t kMaxSecond = 1024;  // second differences that tell the noise

// The reference's light along one axis, of the typical one.
class ReferenceLines {
  public:
    ReferenceLines(const Extents& extents, const ReferenceMaps& reference, std::size_t axis, double typical)
        : e_(extents), reference_(reference), along_(axis == 0 ? 1 : extents.m), across_(axis == 0 ? extents.m : 1),
          typical_(typical) {}

    [[nodiscard]] double at(std::size_t k, int along, int across = 0) const {
        return static_cast<double>(reference_.light[moved(k, along, across)]) / typical_;
    }
    [[nodiscard]] bool usable(std::size_t k, int reach) const {
        for (int a = -reach; a <= reach; ++a) {
            if ((reference_.mask[moved(k, a, 0)] & (kOutside | kSaturated)) != 0) return false;
        }
        return true;
    }
    // Over two lenslets on each side.
    [[nodiscard]] double step(std::size_t k, int across = 0) const {
        return 0.5 * (at(k, 1, across) + at(k, 2, across) - at(k, -1, across) - at(k, -2, across));
    }
    // Standard deviation of a lenslet's light: the second differences of most lenslets are noise.
    [[nodiscard]] double noise() const;

    struct Step {
        double place, slant, before, behind;
    };
    [[nodiscard]] std::optional<Step> step_at(std::size_t k, double least) const;

  private:
    // Behind (1) or before (-1) a step; none if it changes by more than `most`.
    [[nodiscard]] std::optional<double> level(std::size_t k, int side, double most) const;
    // Where a step between these levels is on a line beside that of lenslet `k`: what the lenslets around it have of
    // it, together.
    [[nodiscard]] double place_of(std::size_t k, int across, const Step& levels) const {
        double behind = 0;
        for (int a = 1 - kFlat; a < kFlat; ++a)
            behind += (at(k, a, across) - levels.before) / (levels.behind - levels.before);
        return kFlat - 0.5 - behind;
    }
    [[nodiscard]] std::size_t moved(std::size_t k, int along, int across) const {
        return static_cast<std::size_t>(static_cast<std::ptrdiff_t>(k) + along * along_ + across * across_);
    }
    Extents e_;
    const ReferenceMaps& reference_;
    std::ptrdiff_t along_, across_;
    double typical_;
};

double ReferenceLines::noise() const {
    std::array<double, kMaxSecond> second;
    std::size_t count = 0, seen = 0;
    const std::size_t every = e_.lenslets() / kMaxSecond + 1;
    for (int n = 1; n + 1 < e_.n; ++n) {
        for (int m = 1; m + 1 < e_.m; ++m) {
            const std::size_t k = e_.index(m, n);
            if (seen++ % every != 0 || count == kMaxSecond || !usable(k, 1)) continue;
            second[count++] = std::abs(at(k, 1) + at(k, -1) - 2 * at(k, 0));
        }
    }
    if (count == 0) return 0;
    return common::lower_median(std::span(second).first(count)) / (0.6745 * std::sqrt(6.0));
}

std::optional<double> ReferenceLines::level(std::size_t k, int side, double most) const {
    double sum = 0, least = at(k, side * kFlat), largest = least;
    for (int a = kFlat; a <= kReach; ++a) {
        const double value = at(k, side * a);
        sum += value, least = std::min(least, value), largest = std::max(largest, value);
    }
    if (largest - least > most) return std::nullopt;
    return sum / (kReach - kFlat + 1);
}

std::optional<ReferenceLines::Step> ReferenceLines::step_at(std::size_t k, double least) const {
    const double here = step(k), height = std::abs(here);
    if (!(height > least)) return std::nullopt;
    for (int a = -kFlat; a <= kFlat; ++a) {
        const double other = std::abs(step(moved(k, a, 0)));
        if (other > height || (other == height && a < 0)) return std::nullopt;
    }
    if (!usable(k, kReach)) return std::nullopt;
    Step found{};
    const double uneven = std::max(kUneven * height, least);
    const std::optional<double> before = level(k, -1, uneven), behind = level(k, 1, uneven);
    if (!before || !behind) return std::nullopt;
    found.before = *before, found.behind = *behind;
    const double by = found.behind - found.before;
    if (!(std::abs(by) > least)) return std::nullopt;
    for (int a = 1 - kFlat; a < kFlat; ++a) {
        const double share = (at(k, a) - found.before) / by;
        if (share * std::abs(by) < -uneven || (share - 1) * std::abs(by) > uneven) return std::nullopt;
    }
    found.place = place_of(k, 0, found);
    found.slant = 0.5 * (place_of(k, 1, found) - place_of(k, -1, found));
    if (!(std::abs(found.slant) <= kMaxSlant)) return std::nullopt;
    return found;
}

// Chooses a share of the lines evenly: multiples of the golden ratio lie evenly in 0..1.
struct Chooser {
    std::size_t of = 0, seen = 0;
    bool next() { return seen++ * 1597 % 2584 * of < 2584 * StepLines::kMax; }
};

// Integral of max(x, 0).
double half_square(double x) { return x > 0 ? 0.5 * x * x : 0; }

}  // namespace

// A lenslet's square lets a slanted step pass along a trapezoid.
double StepLine::share(int k, double aside) const {
    const double x = k - place - aside, half = 0.5 * std::abs(slant);
    if (half < 1e-3) return std::clamp(x + 0.5, 0.0, 1.0);
    return (half_square(x + 0.5 + half) - half_square(x + 0.5 - half) - half_square(x - 0.5 + half) +
            half_square(x - 0.5 - half)) /
        (2 * half);
}

void StepLines::collect(const Extents& e, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                        std::size_t axis, double typical, double light) {
    const ReferenceLines lines(e, reference, axis, typical);
    const double least = kCertain * lines.noise();
    const auto along = axis == 0 ? std::ptrdiff_t{1} : std::ptrdiff_t{e.m};
    const int first_m = axis == 0 ? kReach + kFlat : 1, first_n = axis == 0 ? 1 : kReach + kFlat;
    const auto for_each = [&](auto&& each) {
        for (int n = first_n; n + first_n < e.n; ++n) {
            for (int m = first_m; m + first_m < e.m; ++m) {
                if (const auto step = lines.step_at(e.index(m, n), least)) each(m, n, *step);
            }
        }
    };
    double sum = 0;
    Chooser chooser;
    for_each(
        [&](int m, int n, const ReferenceLines::Step& step) { sum += (axis == 0 ? m : n) + step.place, ++chooser.of; });
    if (chooser.of == 0) return;
    const double middle_of_part = sum / static_cast<double>(chooser.of);
    for_each([&](int m, int n, const ReferenceLines::Step& step) {
        if (!chooser.next()) return;
        const double at_m = m + (axis == 0 ? step.place : 0), at_n = n + (axis == 1 ? step.place : 0);
        const auto p = map.to_part(at_m, at_n);
        const int part_m = floor_of(p.m + 0.5), part_n = floor_of(p.n + 0.5);
        const int reach_m = axis == 0 ? kReach : 0, reach_n = axis == 1 ? kReach : 0;
        if (part_m < reach_m || part_n < reach_n || part_m + reach_m >= e.m || part_n + reach_n >= e.n) return;
        const std::size_t which = (axis == 0 ? at_m : at_n) < middle_of_part ? 0 : 1;
        if (count[which] == kMax) return;
        const auto along_step = axis == 0 ? map.turned(step.slant, 1) : map.turned(1, step.slant);
        const double slant = axis == 0 ? along_step.m / along_step.n : along_step.n / along_step.m,
                     place = axis == 0 ? p.m - part_m + slant * (part_n - p.n) : p.n - part_n + slant * (part_m - p.m);
        StepLine line{static_cast<double>(axis == 0 ? part_n : part_m), place, slant, step.before, step.behind, {}};
        const auto middle = static_cast<std::ptrdiff_t>(e.index(part_m, part_n));
        for (int k = -kReach; k <= kReach; ++k) {
            const auto at = static_cast<std::size_t>(middle + k * along);
            if ((part.mask[at] & kSaturated) != 0) return;
            line.light[static_cast<std::size_t>(k + kReach)] = static_cast<double>(part.sums[at]) / (light * typical);
        }
        of[which][count[which]++] = line;
    });
}

}  // namespace hord::algo
