// RimFinder: over how many lenslets the light changes at the part's edges.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/statistics.h"

namespace hord::algo {

using namespace outline;

namespace {
constexpr int kWidest = 15;          // lenslets; wider edges count so
constexpr int kFreeBeside = 12;      // lenslets outside the part, the brightest of which is the free light
constexpr double kMinDeflected = 2;  // times the tolerance of free light, by which a part deflects light at its edge
constexpr double kDarkEdgeSigmas = 3.5;  // one of the 27 lenslets about an edge is so dark by noise in 0.6 % of lines
// These two were chosen on drawn frames, not derived. Frames that were not looked at: docs/results/inspection.md.
constexpr double kRampSigmas = 1.5;     // the light of the glass or the free light is beyond by noise in 7 % of lines
constexpr double kMinSeenOfStep = 0.3;  // half of the way from four fifths to a fifth
constexpr double kBinRipple = 1.27;     // a spot's mean moves up to so many times as fast as the spot
// Lenslets about the first two that are darker than `half` in which light falls from `outer` to `inner`.
template <class LightAt>
int width_of_step(const LightAt& light_at, int outermost, int innermost, double half, double outer, double inner) {
    int first = outermost, width = 0;
    while (first + 1 < innermost && !(light_at(first) < half && light_at(first + 1) < half)) ++first;
    for (int k = first - 1; k >= outermost && light_at(k) < outer; --k) ++width;
    for (int k = first; k < innermost && light_at(k) > inner; ++k) ++width;
    return width;
}

}  // namespace

double RimFinder::deflection_squared(const FieldLight& light, std::size_t k) const {
    const Deflection& d = light.deflections[k];
    const auto x = static_cast<double>(std::int64_t{d.x.raw()} - free_.x.raw()),
               y = static_cast<double>(std::int64_t{d.y.raw()} - free_.y.raw());
    return x * x + y * y;
}

// How far light is deflected from the free light, along the worse axis, over the tolerance of free light: from where
// the dark level alone would leave the mean of so little light, if that is nearer.
double RimFinder::bend_of(const FieldLight& light, const LightScale& scale, std::size_t k) const {
    const LightScale::Shift shift =
        scale.shift(scale.share(static_cast<double>(light.sums[k]) / static_cast<double>(free_light_)));
    constexpr double kOne = 1 << DeflectionQ::kFractionBits;
    const double x = static_cast<double>(light.deflections[k].x.raw() - std::int64_t{free_.x.raw()}),
                 y = static_cast<double>(light.deflections[k].y.raw() - std::int64_t{free_.y.raw()});
    const auto from = [&](double to_x, double to_y) { return std::max(std::abs(x - to_x), std::abs(y - to_y)); };
    return std::min(from(0, 0), from(shift.x * kOne, shift.y * kOne)) / static_cast<double>(NearFree::kTolerance);
}

bool RimFinder::is_undeflected(const FieldLight& light, const LightScale& scale, std::size_t k) const {
    return NearFree(free_).has(light.deflections[k]) || bend_of(light, scale, k) <= 1;
}

// The lenslets of a line in which the deflection grows, from the field inwards, from a fifth to four fifths of the
// largest within kWidest lenslets of the part; none if it is small, or grows no faster than inside the part.
RimFinder::Ramp RimFinder::ramp_at_edge(const FieldLight& light, const LineOfPart& line, double own_slope) const {
    const auto is_dark = [&](int in) { return (light.mask[line.at(in)] & kDark) != 0; };
    const auto squared = [&](int in) { return deflection_squared(light, line.at(in)); };
    constexpr double kMin = kMinDeflected * static_cast<double>(NearFree::kTolerance), kFifth = 0.2 * 0.2,
                     kFourFifths = 0.8 * 0.8;
    double largest = 0;
    for (int k = 0; k < std::min(line.inside / 2, kWidest); ++k)
        largest = is_dark(k) ? largest : std::max(largest, squared(k));
    if (largest < kMin * kMin) return {};
    int end = 0;
    while (is_dark(end) || squared(end) < kFourFifths * largest) ++end;
    int begin = end;
    while (begin > -line.outside && !is_dark(begin - 1) && squared(begin - 1) >= kFifth * largest) --begin;
    const double steps = end - begin + 1;  // from what is free yet
    return std::sqrt(squared(end)) > kBinRipple * own_slope * steps ? Ramp{begin, end} : Ramp{};
}

// The steepest change of the deflection over three lenslets, a lenslet, in the middle half of each line: the upper
// quartile of the lines, so that most of a part shows it.
template <class Lines>
double RimFinder::slope_inside(const FieldLight& light, Lines&& for_each_line) {
    constexpr int kOver = 3;
    std::size_t lines = 0;
    for_each_line([&](const LineOfPart& line, const LineOfPart&) {
        const auto is_lit = [&](int in) { return (light.mask[line.at(in)] & kDark) == 0; };
        double steepest = 0;
        for (int k = line.inside / 4; k + kOver <= 3 * line.inside / 4; ++k) {
            if (!is_lit(k) || !is_lit(k + kOver)) continue;
            const double before = std::sqrt(deflection_squared(light, line.at(k))),
                         after = std::sqrt(deflection_squared(light, line.at(k + kOver)));
            steepest = std::max(steepest, std::abs(after - before) / kOver);
        }
        ring_values_[lines++] = std::llround(steepest);
    });
    if (lines == 0) return 0;
    return static_cast<double>(common::nth_smallest(std::span(ring_values_).first(lines), 3 * (lines - 1) / 4));
}

// Lenslets of a line that show undeflected light of a fifth to four fifths of the free light, or belong to its ramp. -1
// where no free light lies beside the part.
int RimFinder::width_of_edge(const FieldLight& light, const LightScale& scale, const LineOfPart& line,
                             double own_slope) const {
    constexpr int kMinFree = 3;  // of kFreeBeside, that show free light
    std::uint32_t free = 0;
    int count = 0;
    for (int k = 1; k <= std::min(line.outside, kFreeBeside); ++k) {
        if ((state_[line.at(-k)] & kReached) == 0) continue;
        free = std::max(free, light.sums[line.at(-k)]);
        ++count;
    }
    if (count < kMinFree) return -1;
    const Ramp ramp = ramp_at_edge(light, line, own_slope);
    const double fifth = scale.left(0.2) * free, four_fifths = scale.left(0.8) * free;
    const auto is_partial = [&](int in) {
        const std::size_t k = line.at(in);
        if (in >= ramp.begin && in < ramp.end) return true;
        return light.sums[k] > fifth && light.sums[k] < four_fifths && is_undeflected(light, scale, k);
    };
    int before = std::min(ramp.begin, 0), behind = std::max(ramp.begin, 0);
    while (before > -line.outside && is_partial(before - 1)) --before;
    while (behind < line.inside && is_partial(behind)) ++behind;
    int width = 0;
    for (int k = before; k < behind; ++k) width += is_partial(k) ? 1 : 0;
    return std::min(width, kWidest);
}

// The median light of some undeflected lenslets in the middle half of a line; 0 if they are fewer than half of those.
std::uint32_t RimFinder::light_of_glass(const FieldLight& light, const LightScale& scale,
                                        const LineOfPart& line) const {
    constexpr int kMaxSeen = 9;
    std::array<std::uint32_t, kMaxSeen> glass{};
    std::size_t count = 0;
    const int begin = line.inside / 4, length = 3 * line.inside / 4 - begin, seen = std::min(length, kMaxSeen);
    for (int k = 0; k < seen; ++k) {
        const std::size_t at = line.at(begin + (2 * k + 1) * length / (2 * seen));
        if ((light.mask[at] & kDark) == 0 && is_undeflected(light, scale, at)) glass[count++] = light.sums[at];
    }
    if (2 * static_cast<int>(count) <= seen) return 0;
    return common::lower_median(std::span(glass).first(count));
}

// The standard deviation of the light of a lenslet of the glass: by the median of the differences of two side by side
// in the middle of each line. 0 if few lines show it.
template <class Lines>
double RimFinder::noise_of_glass(const FieldLight& light, const LightScale& scale, Lines&& for_each_line) {
    const auto shows_glass = [&](std::size_t k) {
        return (light.mask[k] & kDark) == 0 && is_undeflected(light, scale, k);
    };
    deviations_.clear();
    for_each_line([&](const LineOfPart& line, const LineOfPart&) {
        const std::size_t a = line.at(line.inside / 2), b = line.at(line.inside / 2 - 1);
        if (shows_glass(a) && shows_glass(b))
            deviations_.push_back(std::abs(static_cast<double>(light.sums[a]) - static_cast<double>(light.sums[b])));
    });
    if (static_cast<int>(deviations_.size()) < kMinBeside) return 0;
    return 1.4826 / std::numbers::sqrt2 * common::lower_median(std::span(deviations_));
}

// The lenslets of a line that are neither free light, nor tinted glass, nor dark: those in which light falls from four
// fifths to a fifth of the way from the free light to the darkest lenslet, that lenslet, and those behind it up to half
// way to the light of the glass; those with less than a fifth of the light of the glass are dark. -1 if the glass is
// clear. Where no lenslet is darker than noise, and light that is bent within the bins, explain: one more than those in
// which light falls from four fifths to a fifth of the way from the free light to that of the glass.
int RimFinder::width_before_glass(const FieldLight& light, const LightScale& scale, double glass_noise,
                                  const LineOfPart& line) const {
    constexpr double kClear = 7.0 / 8;  // of the free light: above the four fifths by the noise of a lenslet
    std::array<std::uint32_t, kFreeBeside> beside{};
    std::uint32_t brightest = 0;
    std::size_t count = 0;
    for (int k = 1; k <= std::min(line.outside, kFreeBeside); ++k) {
        if ((state_[line.at(-k)] & kReached) == 0) continue;
        beside[count++] = light.sums[line.at(-k)];
        brightest = std::max(brightest, light.sums[line.at(-k)]);
    }
    if (light.sums[line.at(line.inside / 2)] >= scale.left(kClear) * brightest) return -1;  // most are clear
    const std::uint32_t glass = light_of_glass(light, scale, line);
    if (glass == 0) return -1;
    // The upper quartile: the nearer half may show a second exposure of the part.
    const double free = common::nth_smallest(std::span(beside).first(count), 3 * (count - 1) / 4);
    if (glass >= scale.left(kClear) * free) return -1;
    const auto light_at = [&](int in) { return light.sums[line.at(in)]; };
    const int outermost = -std::min(line.outside, kFreeBeside), innermost = std::min(line.inside / 2, kWidest);
    const auto left = [&](double share) { return scale.left(share) * free; };  // DN
    const double of_glass = scale.share(glass / free);
    // The dark level takes more of the light that a bevel bends in a half of a lenslet than of the same light in one
    // spot. Such a lenslet shows deflected light: by half of the bend, which is half a bin or more.
    const double lost_of_two_spots = glass - std::min<double>(glass, 2 * left(of_glass / 2));
    const double least_of_glass = glass - kDarkEdgeSigmas * glass_noise;
    const auto without_loss = [&](int in) {
        const std::size_t k = line.at(in);
        const bool may_be_bent = light.sums[k] < least_of_glass && (light.mask[k] & kDark) == 0;
        return light.sums[k] + (may_be_bent ? lost_of_two_spots * std::min(1.0, bend_of(light, scale, k)) : 0);
    };
    int darkest = 0;
    double least_light = without_loss(0);
    for (int k = outermost; k < innermost; ++k) {
        if (const double here = without_loss(k); here < least_light) darkest = k, least_light = here;
    }
    const double outer_of_step = std::min(left(0.8 + 0.2 * of_glass), free - kRampSigmas * glass_noise),
                 inner_of_step = std::max(left(0.2 + 0.8 * of_glass), glass + kRampSigmas * glass_noise);
    // Where noise hides more than half of the step's three fifths, nothing proves that the part was at rest.
    const bool shows_step = outer_of_step - inner_of_step >= kMinSeenOfStep * (free - glass);
    if (least_light > least_of_glass && shows_step) {  // no dark edge: one step from the free light to the glass
        const double half = left((1 + of_glass) / 2);
        return std::min(2 * kMaxEdgeWidth,
                        1 + width_of_step(light_at, outermost, innermost, half, outer_of_step, inner_of_step));
    }
    const double least = scale.share(light_at(darkest) / free);
    const double dark = left(0.2 * of_glass), outer = left(0.8 + 0.2 * least), inner = left(0.2 + 0.8 * least),
                 behind = left((of_glass + least) / 2);
    int width = light_at(darkest) <= dark ? 0 : 1;
    for (int k = darkest - 1; k >= outermost && light_at(k) < outer; --k) width += light_at(k) > inner ? 1 : 0;
    for (int k = darkest + 1; k < innermost && light_at(k) < behind; ++k) width += light_at(k) > dark ? 1 : 0;
    return std::min(width, 2 * kMaxEdgeWidth);
}

void RimFinder::measure_edges(const FieldLight& light, const LightScale& scale) {
    if (regions_ > 0 && found_.free_light) found_.edge_width = edge_width(light, scale);
}

// At both ends of the part in each row and each column. An edge in focus covers one lenslet in part, or two if it lies
// askew. An edge that moved, or was exposed twice, is as wide as it moved. The median of the rows, or of the columns if
// it is wider; of a tube only across its axis, because its ends are as deep as it is wide. The light of tinted glass
// looks like a part of such an edge. So if most lines show tinted glass, it is the mean of the widths before the glass,
// rounded up: at rest 2 at most, one lenslet towards the free light and one towards the glass. A median could not tell
// 1.5 from 2.
int RimFinder::edge_width(const FieldLight& light, const LightScale& scale) {
    struct Width {
        int edges = 0, width = 0;
    };
    const auto width_of = [&](int lines, int length, auto&& index) {
        const auto step = static_cast<std::ptrdiff_t>(index(0, 1) - index(0, 0));
        const auto for_each_line = [&](auto&& visit) {
            for (int line = 0; line < lines; ++line) {
                const auto is_part = [&](int k) { return (state_[index(line, k)] & kPart) != 0; };
                int first = 0, last = length - 1;
                while (first < length && !is_part(first)) ++first;
                while (last > first && !is_part(last)) --last;
                if (first >= last) continue;
                const int inside = last - first + 1;
                visit(LineOfPart{index(line, first), step, first, inside},
                      LineOfPart{index(line, last), -step, length - 1 - last, inside});
            }
        };
        const double glass_noise = noise_of_glass(light, scale, for_each_line);
        const auto typical = [&](double own_slope) {
            std::array<int, kWidest + 1> edges{};  // of so many lenslets
            int all = 0, seen = 0, width = 0, of_glass = 0, before_glass = 0;
            for_each_line([&](const LineOfPart& near, const LineOfPart& far) {
                for (const LineOfPart& line : {near, far}) {
                    const int found = width_of_edge(light, scale, line, own_slope);
                    if (found < 0) continue;
                    const int before = width_before_glass(light, scale, glass_noise, line);
                    if (before >= 0) {
                        ++of_glass;
                        before_glass += before;
                    }
                    ++edges[static_cast<std::size_t>(found)];
                    ++all;
                }
            });
            if (all < kMinBeside) return Width{};
            if (2 * of_glass > all) return Width{all, (before_glass + of_glass - 1) / of_glass};
            while (2 * (seen += edges[static_cast<std::size_t>(width)]) < all) ++width;
            return Width{all, width};
        };
        const Width any = typical(0);
        return any.width <= kMaxEdgeWidth ? any : typical(slope_inside(light, for_each_line));
    };
    const auto in_rows = [&] {
        return width_of(extents_.n, extents_.m, [&](int n, int m) { return extents_.index(m, n); });
    };
    const auto in_columns = [&] {
        return width_of(extents_.m, extents_.n, [&](int m, int n) { return extents_.index(m, n); });
    };
    if (tube_) return (tube_->along_columns() ? in_rows() : in_columns()).width;
    const Width rows = in_rows(), columns = in_columns();
    // Few lines of an axis are those along an edge that is a little askew, as of a plate from border to border.
    return std::max(2 * rows.edges >= columns.edges ? rows.width : 0,
                    2 * columns.edges >= rows.edges ? columns.width : 0);
}

}  // namespace hord::algo
