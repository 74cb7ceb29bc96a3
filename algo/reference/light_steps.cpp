#include "algo/reference/light_steps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "algo/frame/mask.h"
#include "algo/reference/limit_of_parts.h"
#include "algo/reference/step_lines.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr double kFarthestStep = 1.5;  // lenslets that a side may lie from the reference's
constexpr double kCoarse = 0.5;        // of the search; halved until kFine
constexpr double kFine = 0.0625;       // lenslets; a parabola tells the rest
constexpr double kLinear = 0.5;        // lenslets of noise, at which one of 10,000 lies: as wide as half of a step
constexpr double kForeign = 3;  // of the median square, from which a line is another's: noise reaches it in one of 50
constexpr std::size_t kPieces = 6;       // of a side: a chip as wide as two thirds of it is in four
constexpr double kMedianNoise = 1.2533;  // standard error of a median over that of a mean

// One side of the part: its lines, and by how much its light differs from the reference's outside and inside.
struct Side {
    std::span<StepLine> lines;
    double before = 0, behind = 0;    // of the typical light
    double offset = 0, variance = 0;  // of its middle
    double middle = 0, slope = 0;     // offset's change along the side: a clear plate's turn may not be known

    // What a sharp step shows at lenslet `k` of a line, if the side's middle lies `aside` the reference's.
    [[nodiscard]] double expected(const StepLine& line, int k, double aside) const {
        const double share = line.share(k, aside + slope * (line.along - middle));
        return (1 - share) * (line.before + before) + share * (line.behind + behind);
    }
};

// Where neither a step nor its motion reaches.
void find_levels(Side& side) {
    double before = 0, behind = 0, count = 0;
    for (const StepLine& line : side.lines) {
        for (int k = -StepLine::kReach; k <= -StepLine::kFlat; ++k) before += line.at(k) - line.before;
        for (int k = StepLine::kFlat; k <= StepLine::kReach; ++k) behind += line.at(k) - line.behind;
        count += StepLine::kReach - StepLine::kFlat + 1;
    }
    side.before = before / count, side.behind = behind / count;
}

double cost(const Side& side, const StepLine& line, double offset) {
    double sum = 0;
    for (int k = 1 - StepLine::kFlat; k < StepLine::kFlat; ++k) {
        const double r = line.at(k) - side.expected(line, k, offset);
        sum += r * r;
    }
    return sum;
}
double cost(const Side& side, double offset) {
    double sum = 0;
    for (const StepLine& line : side.lines) sum += cost(side, line, offset);
    return sum;
}

// Lenslets by which a line's step lies farther behind than its side's.
double offset_of(const Side& side, const StepLine& line) {
    double sum = 0;
    for (int k = 1 - StepLine::kFlat; k < StepLine::kFlat; ++k) sum += side.expected(line, k, side.offset) - line.at(k);
    return sum / (line.behind + side.behind - line.before - side.before);
}

// The slope that is left. Precondition: `offset`.
void find_slope(Side& side) {
    double sum = 0;
    for (const StepLine& line : side.lines) sum += line.along;
    side.middle = sum / static_cast<double>(side.lines.size());
    double products = 0, squares = 0;
    for (const StepLine& line : side.lines) {
        const double from = line.along - side.middle;
        products += from * offset_of(side, line), squares += from * from;
    }
    if (squares > 0) side.slope += products / squares;
}

// Square of the standard error of a side's offset, by what its pieces differ. Another size and a shift move all of them
// alike. A chip moves a few: lines beside one another are not independent, their pieces nearly are.
double variance_of_pieces(const Side& side) {
    std::array<double, kPieces> mean{};
    double sum = 0, squares = 0;
    for (std::size_t p = 0; p < kPieces; ++p) {
        const std::size_t first = p * side.lines.size() / kPieces, end = (p + 1) * side.lines.size() / kPieces;
        for (const StepLine& line : side.lines.subspan(first, end - first))
            mean[p] += offset_of(side, line) + side.slope * (line.along - side.middle);
        mean[p] /= static_cast<double>(end - first);
        sum += mean[p];
    }
    for (const double m : mean) squares += (m - sum / kPieces) * (m - sum / kPieces);
    return squares / (kPieces * (kPieces - 1));
}

// False if noise hides where the side lies.
bool find_offset(Side& side) {
    double at = 0, best = cost(side, 0);
    const auto consider = [&](double offset) {
        if (const double other = cost(side, offset); other < best) best = other, at = offset;
    };
    for (double offset = kCoarse; offset <= kFarthestStep; offset += kCoarse) consider(-offset), consider(offset);
    for (double step = 0.5 * kCoarse; step >= kFine; step *= 0.5) {
        const double middle = at;
        consider(middle - step), consider(middle + step);
    }
    const double before = cost(side, at - kFine), behind = cost(side, at + kFine), bend = before + behind - 2 * best;
    if (!(bend > 0)) return false;
    side.offset = at + std::clamp(0.5 * (before - behind) / bend, -1.0, 1.0) * kFine;
    // One lenslet of a line is on the step, whose slope there is the step's height.
    double slopes = 0;
    for (const StepLine& line : side.lines) slopes += (line.behind - line.before) * (line.behind - line.before);
    const double count = static_cast<double>(side.lines.size()) * (2 * StepLine::kFlat - 1);
    side.variance = best / count / slopes;
    return kLimitNoises * std::sqrt(side.variance) < kLinear;
}

// Leaves out lines that differ far more than most do: a piece that is missing at the outline. Motion changes all. False
// if that is more than a quarter of the side: its lenslets are judged, not where it lies.
bool keep_alike(Side& side) {
    std::array<double, StepLines::kMax> costs;
    std::size_t count = 0;
    for (const StepLine& line : side.lines) costs[count++] = cost(side, line, side.offset);
    const double most = kForeign * common::lower_median(std::span(costs).first(count));
    const auto others = std::remove_if(side.lines.begin(), side.lines.end(),
                                       [&](const StepLine& line) { return cost(side, line, side.offset) > most; });
    const auto alike = static_cast<std::size_t>(others - side.lines.begin());
    const bool whole = 4 * (side.lines.size() - alike) <= side.lines.size();
    side.lines = side.lines.first(alike);
    return whole;
}

// False if the side has too few lines, or noise hides where it lies.
bool fit(Side& side) {
    if (side.lines.size() < StepLines::kMin) return false;
    find_levels(side);
    if (!find_offset(side)) return false;
    find_slope(side);
    if (!keep_alike(side)) return false;
    find_levels(side);
    if (!find_offset(side)) return false;
    find_slope(side);
    if (!find_offset(side)) return false;
    side.variance = std::max(side.variance, variance_of_pieces(side));
    return true;
}

// Change of a line over that by two exposures, a lenslet before and behind.
struct Ratio {
    double value, weight;
};

struct Ratios {
    std::array<Ratio, 2 * StepLines::kMax> of;
    std::size_t count = 0;
    double weights = 0;

    void add(const Side& side) {
        for (const StepLine& line : side.lines) {
            double product = 0, weight = 0;
            for (int k = 1 - StepLine::kFlat; k < StepLine::kFlat; ++k) {
                const double here = side.expected(line, k, side.offset),
                             by_motion = 0.5 *
                        (side.expected(line, k, side.offset - 1) + side.expected(line, k, side.offset + 1)) -
                    here;
                product += by_motion * (line.at(k) - here), weight += by_motion * by_motion;
            }
            if (!(weight > 0)) continue;  // its step has no height
            of[count++] = {product / weight, weight};
            weights += weight;
        }
    }
    // Weighted: a piece that is missing at the outline changes few lines, motion changes all.
    double median() {
        const std::span<Ratio> all = std::span(of).first(count);
        std::ranges::sort(all, {}, &Ratio::value);
        double seen = 0;
        for (const Ratio& r : all) {
            seen += r.weight;
            if (2 * seen >= weights) return r.value;
        }
        return 0;
    }
    [[nodiscard]] double noise(double median) const {
        double squares = 0;
        for (const Ratio& r : std::span(of).first(count))
            squares += r.weight * r.weight * (r.value - median) * (r.value - median);
        return kMedianNoise * std::sqrt(squares) / weights;
    }
};

double allowed(float limit, double noise) {
    const auto learned = static_cast<double>(limit);
    return learned > 0 ? std::hypot(learned, kLimitNoises * noise) : 0;
}

}  // namespace

LightSteps compare_light_steps(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part,
                               const PoseMap& map, double typical, double light) {
    LightSteps result;
    for (const std::size_t axis : {0U, 1U}) {
        StepLines lines;
        lines.collect(extents, reference, part, map, axis, typical, light);
        std::array<Side, 2> sides{};
        std::array<bool, 2> known{};
        Ratios ratios;
        for (const std::size_t s : {0U, 1U}) {
            sides[s].lines = lines.side(s);
            known[s] = fit(sides[s]);
            if (known[s]) ratios.add(sides[s]);
        }
        if (known[0] && known[1]) {
            SizeDifference& size = result.size;
            size.known[axis] = true;
            size.wider[axis] = sides[1].offset - sides[0].offset;
            size.shift[axis] = 0.5 * (sides[0].offset + sides[1].offset);
            size.apart[axis] = std::max(std::abs(sides[0].offset), std::abs(sides[1].offset));
            size.allowed[axis] = allowed(reference.size_limits[axis], std::sqrt(sides[0].variance + sides[1].variance));
        }
        if (ratios.count > 0 && ratios.weights > 0) {
            EdgeBlur& blur = result.blur;
            blur.known[axis] = true;
            blur.blur[axis] = ratios.median();
            blur.noise[axis] = ratios.noise(blur.blur[axis]);
            blur.allowed[axis] = allowed(reference.blur_limits[axis], blur.noise[axis]);
        }
    }
    return result;
}

}  // namespace hord::algo
