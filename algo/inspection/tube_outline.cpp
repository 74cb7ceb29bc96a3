#include "algo/inspection/tube_outline.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "algo/frame/mask.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"
#include "common/statistics.h"

namespace hord::algo {

using namespace outline;

namespace {

constexpr std::size_t kMinLines = 8;            // lines across the tube that show its outline, to fit an edge
constexpr std::int64_t kNearMedians = 3 << 15;  // 1.5 lenslets: both medians' errors, and half a lenslet of rounding
constexpr int kEdgeReach = 3;                   // lenslets from the outer edge in which a flank begins
constexpr int kMinBand = 3;  // places next to each other with the band's light; fewer: a bright line in a flank
constexpr unsigned kLightOf = 8, kLightNeeded = 7;  // a lenslet of the band has 7/8 of its typical light
constexpr int kQuorumOf = 4, kQuorum = 3;           // of the lines across that make a distance from the edge flank: 3/4
constexpr int kStraight = 8;                        // an edge follows its line to 1/8 of the tube's width
constexpr int kEndMargins = 2;                      // margins at an end: a tube is as deep as it is wide
constexpr double kBinRipple = 1.27;                 // a spot's mean moves up to so many times as fast as the spot
constexpr int kSteepShare = 4;                      // at most 1/4 of the lit band, on each side, is flank for its slope

}  // namespace

TubeOutline::TubeOutline(const Extents& extents, int margin, float steepest_bins)
    : extents_(extents), margin_(margin),
      steepest_(std::llround(2 * static_cast<double>(steepest_bins) * (1 << DeflectionQ::kFractionBits))),
      scratch_(extents.lenslets()), body_(extents.lenslets()), own_slopes_(extents.lenslets()) {
    const auto longest = static_cast<std::size_t>(std::max(extents.m, extents.n));
    for (Side& side : sides_) side.edge.resize(longest);
    first_.resize(longest);
    last_.resize(longest);
    present_.reserve(longest);
    values_.resize(longest);
}

bool TubeOutline::find(const FieldLight& light, std::span<std::uint8_t> state) {
    std::ranges::fill(own_slopes_, OwnSlope{});
    // The axis is the direction in which more lines across begin and end in a flank.
    View view{extents_};
    int most = -1;
    for (const bool along_columns : {true, false}) {
        const View tried{extents_, along_columns};
        find_edges(tried, state);
        find_typical_light(tried, light);
        const int lines = lines_with_flanks(tried, light);
        if (lines > most) most = lines, view = tried;
    }
    along_columns_ = view.along_columns;
    find_edges(view, state);
    find_typical_light(view, light);
    if (!fit_line(view, sides_[0]) || !fit_line(view, sides_[1])) return false;
    const int middle = present_[present_.size() / 2];
    width_ = view.width() - sides_[0].line(middle) - sides_[1].line(middle);
    if (!find_straight(view, sides_[0]) || !find_straight(view, sides_[1])) return false;
    find_flanks(view, light);
    has_dark_flanks_ = find_dark_flanks(view, light);
    find_ends(view);
    if (enclose(view) * kSmallestPart < extents_.lenslets()) return false;
    for (std::size_t k = 0; k < state.size(); ++k) {
        state[k] = static_cast<std::uint8_t>((state[k] & ~kPart) | body_[k] | (body_[k] != 0 ? kPart : 0));
    }
    find_own_slopes(view, light);
    return true;
}

void TubeOutline::find_edges(View view, std::span<const std::uint8_t> state) {
    for (const bool far : {false, true}) {
        view.from_far_side = far;
        for (int u = 0; u < view.length(); ++u) {
            int v = 0;
            while (v < view.width() && (state[view.at(u, v)] & kPart) == 0) ++v;
            sides_[far ? 1 : 0].edge[static_cast<std::size_t>(u)] = v < view.width() ? v : -1;
        }
    }
}

// The median light between the edges, of lenslets with at least half of the light that an eighth of them exceeds: what
// little light the flanks let through does not count.
void TubeOutline::find_typical_light(View view, const FieldLight& light) {
    std::size_t count = 0;
    for (int u = 0; u < view.length(); ++u) {
        const auto line = static_cast<std::size_t>(u);
        if (sides_[0].edge[line] < 0) continue;
        for (int v = sides_[0].edge[line]; v < view.width() - sides_[1].edge[line]; ++v) {
            const std::size_t k = view.at(u, v);
            if ((light.mask[k] & kNoHord) == 0) scratch_[count++] = light.sums[k];
        }
    }
    typical_ = 0;
    if (count == 0) return;
    const std::span<std::uint32_t> lit = std::span(scratch_).first(count);
    const std::uint32_t bright = common::nth_smallest(lit, (count - 1) * 7 / 8);
    const auto end = std::partition(lit.begin(), lit.end(), [&](std::uint32_t sum) { return 2 * sum >= bright; });
    typical_ = common::lower_median(lit.first(static_cast<std::size_t>(end - lit.begin())));
}

bool TubeOutline::is_flank(View view, const FieldLight& light, int u, int v, bool steep_too) const {
    const std::size_t k = view.at(u, v);
    if ((light.mask[k] & kSaturated) != 0) return false;
    if ((light.mask[k] & kDark) != 0) return true;
    if (std::uint64_t{kLightOf} * light.sums[k] < std::uint64_t{kLightNeeded} * typical_) return true;
    return steep_too && steepest_ > 0 && std::abs(change_across(view, light, u, v)) >= steepest_;
}

// The change of the mean deflection across the axis, over two lenslets, as the slopes are judged
// (algo/features/stencil.h). 0 where it is not known.
std::int64_t TubeOutline::change_across(View view, const FieldLight& light, int u, int v) const {
    const auto usable = [&](int at) {
        return at >= 0 && at < view.width() && (light.mask[view.at(u, at)] & kNoHord) == 0;
    };
    const auto across = [&](int at) {
        const Deflection& d = light.deflections[view.at(u, at)];
        return std::int64_t{(view.along_columns ? d.x : d.y).raw()};
    };
    const int before = usable(v - 1) ? v - 1 : v, after = usable(v + 1) ? v + 1 : v;
    if (before == after) return 0;
    return (across(after) - across(before)) * (2 / (after - before));
}

// The lines across in which both outer edges have a flank.
int TubeOutline::lines_with_flanks(View view, const FieldLight& light) const {
    int lines = 0;
    for (int u = 0; u < view.length(); ++u) {
        bool both = true;
        for (const bool far : {false, true}) {
            view.from_far_side = far;
            const int edge = sides_[far ? 1 : 0].edge[static_cast<std::size_t>(u)];
            bool flank = false;
            for (int v = edge; edge >= 0 && v < std::min(edge + kEdgeReach, view.width()); ++v)
                flank = flank || is_flank(view, light, u, v, false);
            both = both && flank;
        }
        if (both) ++lines;
    }
    return lines;
}

// A straight line through the edge: the median slope between places half of the edge apart, then the median offset. A
// quarter of the places may lie anywhere. The places are whole lenslets, so that both medians are off by up to half a
// lenslet at the ends of the edge; the line of least squares through the places near theirs is not. False if too few
// lines across show the outline.
bool TubeOutline::fit_line(View view, Side& side) {
    present_.clear();
    for (int u = 0; u < view.length(); ++u) {
        if (side.edge[static_cast<std::size_t>(u)] >= 0) present_.push_back(u);
    }
    if (present_.size() < kMinLines) return false;
    const auto edge = [&](std::size_t i) {
        return std::int64_t{side.edge[static_cast<std::size_t>(present_[i])]} * (std::int64_t{1} << 16);
    };
    const std::size_t half = present_.size() / 2, pairs = present_.size() - half;
    for (std::size_t i = 0; i < pairs; ++i)
        values_[i] = (edge(i + half) - edge(i)) / (present_[i + half] - present_[i]);
    side.line.slope = common::lower_median(std::span(values_).first(pairs));
    for (std::size_t i = 0; i < present_.size(); ++i) values_[i] = edge(i) - side.line.slope * present_[i];
    side.line.offset = common::lower_median(std::span(values_).first(present_.size()));
    double n = 0, u = 0, v = 0, uu = 0, uv = 0;
    for (std::size_t i = 0; i < present_.size(); ++i) {
        if (std::abs(edge(i) - side.line.offset - side.line.slope * present_[i]) > kNearMedians) continue;
        const double along = present_[i], across = static_cast<double>(edge(i));
        ++n, u += along, v += across, uu += along * along, uv += along * across;
    }
    const double spread = uu - u * u / n;
    if (n < kMinLines || spread <= 0) return true;
    const double slope = (uv - u * v / n) / spread;
    side.line = {std::llround((v - slope * u) / n), std::llround(slope)};
    return true;
}

// The first and last place where the edge follows its line; a neck or a cap does not. False if there is none.
bool TubeOutline::find_straight(View view, Side& side) const {
    const int most = std::max(margin_ + 1, width_ / kStraight);
    side.first = view.length(), side.last = -1;
    for (const int u : present_) {
        if (std::abs(side.edge[static_cast<std::size_t>(u)] - side.line(u)) > most) continue;
        side.first = std::min(side.first, u);
        side.last = u;
    }
    return side.last >= side.first;
}

// Lenslets from the outer edge to the band: a distance from the edge is flank if kQuorum of the lines across are. The
// flank begins within kEdgeReach of the edge, or where an edge still follows its line: beside a thick wall light is
// gathered or bent a little. The band begins where kMinBand distances in a row are no flank.
int TubeOutline::thickness(View view, const FieldLight& light, const Side& side, bool steep_too) const {
    const int first = std::max(sides_[0].first, sides_[1].first), last = std::min(sides_[0].last, sides_[1].last);
    const int reach = std::max(kEdgeReach, width_ / kStraight);
    int light_in_a_row = 0;
    bool begun = false;
    for (int depth = 0; depth < width_; ++depth) {
        int flank = 0;
        for (int u = first; u <= last; ++u) {
            const int v = side.line(u) + depth;
            if (v < 0 || v >= view.width() || is_flank(view, light, u, v, steep_too)) ++flank;
        }
        const bool of_flank = kQuorumOf * flank >= kQuorum * (last - first + 1);
        begun = begun || of_flank;
        light_in_a_row = of_flank ? 0 : light_in_a_row + 1;
        if (begun ? light_in_a_row == kMinBand : depth >= reach) return begun ? depth + 1 - kMinBand : 0;
    }
    return width_;
}

void TubeOutline::find_flanks(View view, const FieldLight& light) {
    std::array<int, 2> dark{}, steep{};
    for (const std::size_t s : {0U, 1U}) {
        view.from_far_side = s == 1;
        dark[s] = thickness(view, light, sides_[s], false);
        steep[s] = thickness(view, light, sides_[s], true);
    }
    // A band that is steep over more than its borders is judged as it is.
    const int band = width_ - dark[0] - dark[1];
    const bool borders_only = kSteepShare * (steep[0] - dark[0]) <= band && kSteepShare * (steep[1] - dark[1]) <= band;
    const std::array<int, 2>& found = borders_only ? steep : dark;
    // A tube looks alike on both sides of its axis: what is much thicker on one side is a defect there.
    const int most = std::min(found[0], found[1]) + 2 * margin_;
    for (const std::size_t s : {0U, 1U}) sides_[s].thickness = std::min(found[s], most);
}

bool TubeOutline::find_dark_flanks(View view, const FieldLight& light) const {
    int lines = 0, dark = 0;
    for (const int u : present_) {
        bool both = true;
        for (const bool far : {false, true}) {
            view.from_far_side = far;
            const Side& side = sides_[far ? 1 : 0];
            const int edge = std::max(side.line(u), 0),
                      end = std::min(edge + side.thickness + kEdgeReach, view.width());
            bool any = false;
            for (int v = edge; v < end; ++v) {
                const std::size_t k = view.at(u, v);
                any = any || (light.mask[k] & kDark) != 0 || 2 * std::uint64_t{light.sums[k]} < typical_;
            }
            both = both && any;
        }
        ++lines;
        dark += both ? 1 : 0;
    }
    return 2 * dark >= lines;
}

// The two ends of the tube at each place across: straight and square to the axis, through the outermost place where one
// of the edges follows its line. (The other one may be hidden there.)
void TubeOutline::find_ends(View view) {
    const std::int64_t slope = (sides_[0].line.slope - sides_[1].line.slope) / 2;
    const auto along = [&](std::size_t side, int u) {  // position along the axis, 2^-16 lenslets
        const int v = side == 0 ? sides_[0].line(u) : view.width() - 1 - sides_[1].line(u);
        return (std::int64_t{u} << 16) + slope * v;
    };
    const std::int64_t first = std::min(along(0, sides_[0].first), along(1, sides_[1].first)),
                       last = std::max(along(0, sides_[0].last), along(1, sides_[1].last));
    for (int v = 0; v < view.width(); ++v) {
        const auto at = [&](std::int64_t end) {
            return static_cast<int>((end - slope * v + (std::int64_t{1} << 15)) >> 16);
        };
        first_[static_cast<std::size_t>(v)] = at(first);
        last_[static_cast<std::size_t>(v)] = at(last);
    }
}

// Fills body_: all between the two lines and the two ends, and what the outline encloses beyond (a neck, a flange).
// Returns the number of lenslets.
std::size_t TubeOutline::enclose(View view) {
    const int end_margin = kEndMargins * margin_;
    std::size_t count = 0;
    for (int u = 0; u < view.length(); ++u) {
        const auto line = static_cast<std::size_t>(u);
        const int near_line = sides_[0].line(u), far_line = view.width() - 1 - sides_[1].line(u);
        const bool seen = sides_[0].edge[line] >= 0;
        const int near_edge = sides_[0].edge[line], far_edge = view.width() - 1 - sides_[1].edge[line];
        const int near_flank = near_line + sides_[0].thickness + margin_,
                  far_flank = far_line - sides_[1].thickness - margin_;
        for (int v = 0; v < view.width(); ++v) {
            const int first = first_[static_cast<std::size_t>(v)], last = last_[static_cast<std::size_t>(v)];
            std::uint8_t& body = body_[view.at(u, v)];
            body = 0;
            if (!(seen && v >= near_edge && v <= far_edge) &&
                !(v >= near_line && v <= far_line && u >= first && u <= last))
                continue;
            const bool at_end =
                (first > 0 && u < first + end_margin) || (last < view.length() - 1 && u > last - end_margin);
            body = static_cast<std::uint8_t>(kInside | (v < near_flank || v > far_flank || at_end ? kFlank : 0));
            ++count;
        }
    }
    return count;
}

// The median change of the mean deflection, over two lenslets, so far from the side's outer edge. 0 where there is
// none.
std::int64_t TubeOutline::typical_change(View view, const FieldLight& light, const Side& side, int depth) {
    const int first = std::max(sides_[0].first, sides_[1].first), last = std::min(sides_[0].last, sides_[1].last);
    std::size_t count = 0;
    for (int u = first; u <= last; ++u) {
        const int v = side.line(u) + depth;
        if (v >= 0 && v < view.width()) values_[count++] = change_across(view, light, u, v);
    }
    return count == 0 ? 0 : common::lower_median(std::span(values_).first(count));
}

// A tube deflects light by what is in it, the more the farther from its axis. So its own slope at a place is at most
// the typical one at any place farther out, on either side. A scratch along the tube is steep on one side only, or is
// less steep beside itself. What is above the slope that ripple and noise take to the limit grows by the ripple.
void TubeOutline::find_own_slopes(View view, const FieldLight& light) {
    if (steepest_ == 0) return;
    constexpr double kRaw = 2.0 * (1 << DeflectionQ::kFractionBits);  // of a bin pitch a lenslet
    std::int64_t least = std::numeric_limits<std::int64_t>::max();
    const int judged = std::max(sides_[0].thickness, sides_[1].thickness) + margin_;  // of both sides, from here on
    for (int depth = judged; depth <= width_ / 2 + 1; ++depth) {  // over the middle by a lenslet: edges are askew
        std::array<std::int64_t, 2> typical{};
        for (const std::size_t s : {0U, 1U}) {
            view.from_far_side = s == 1;
            typical[s] = typical_change(view, light, sides_[s], depth);
            least = std::min(least, std::abs(typical[s]));
        }
        const bool alike = (typical[0] > 0) != (typical[1] > 0);  // counted from either side
        if (!alike || least <= steepest_) return;                 // as it is farther in
        const double own = kBinRipple * static_cast<double>(least - steepest_) / kRaw;
        for (const std::size_t s : {0U, 1U}) {
            view.from_far_side = s == 1;
            for (int at = depth == judged ? 0 : depth; at <= depth; ++at) {
                for (int u = 0; u < view.length(); ++u) {
                    const int v = sides_[s].line(u) + at;
                    if (v < 0 || v >= view.width()) continue;
                    const double slope = static_cast<double>(change_across(view, light, u, v)) / kRaw;
                    own_slopes_[view.at(u, v)] = {
                        static_cast<float>(own),
                        static_cast<float>(own * own - 2 * slope * (typical[s] > 0 ? own : -own))};
                }
            }
        }
    }
}

}  // namespace hord::algo
