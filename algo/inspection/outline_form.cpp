// RimFinder: what the form of a part says of its outline: whether the field cuts it, and whether pieces of it are
// missing (docs/notes/inspection.md, "What the form explains").
#include <algorithm>

#include "algo/inspection/field_rectangle.h"
#include "algo/inspection/part_state.h"
#include "algo/inspection/rim.h"

namespace hord::algo {

using namespace outline;

namespace {
constexpr double kSeenOfWidth = 0.5;  // of a strip's width, over which both its long edges are seen
}  // namespace

void RimFinder::find_cut() {
    found_.cut = 0;
    if (found_.at_border == 0 || (form_ != PartForm::plate && form_ != PartForm::tube)) return;
    if (form_ == PartForm::plate && rectangle().is_strip(kSeenOfWidth)) return;
    found_.cut = cut_by_border();
}

const FieldRectangle& RimFinder::rectangle() {
    if (!rectangle_) {
        hull_.take(state_, kInside);
        hull_.close();
        rectangle_.emplace(FieldRectangle::about(hull_, extents_));
    }
    return *rectangle_;
}

void RimFinder::look_for_missing_pieces(const FieldLight& light) {
    if (regions_ == 0 || (form_ != PartForm::plate && form_ != PartForm::round)) return;
    hull_.take(state_, kInside);
    hull_.close();
    if (form_ == PartForm::plate) {
        found_.lacks_place = lacks_of_rectangle();
        const int margin = default_rim_margin(extents_);
        found_.notched = has_notch(light, margin) || has_notch(light, 2 * margin);
    }
    found_.lacks_place = found_.lacks_place || lacks_of_circle();
}

// A plate is a rectangle, whose corners may be cut alike, or the same turned by 180 degrees. Of one that the field cuts
// an image beyond the field is not known.
bool RimFinder::lacks_of_rectangle() {
    const FieldRectangle& of = rectangle();
    const auto lacks_square = [&] {
        return has_square(
            [&](int m, int n) { return of.contains(m, n) && (state_[extents_.index(m, n)] & kInside) == 0; });
    };
    if (lacks_image() && (found_.at_border == 0 || lacks_square())) return true;
    const double margin = default_rim_margin(extents_);
    if (found_.at_border > 0 && of.is_strip(kSeenOfWidth)) return of.farthest_from_long_sides(hull_) > margin;
    return of.explains(hull_) && of.uneven_corners(hull_) > margin;
}

// Where most of the outline is a circle: a lenslet farther inside it than the margin is not of the part.
bool RimFinder::lacks_of_circle() {
    if (!circle_.fit(hull_)) return false;
    const double margin = default_rim_margin(extents_);
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            if ((state_[extents_.index(m, n)] & kInside) == 0 && circle_.contains(m, n, margin)) return true;
        }
    }
    return false;
}

// Its width is its area over the longer side of its box. Of a tube only the ends count: the field may cut its flanks.
double RimFinder::cut_by_border() const {
    int first_m = extents_.m, last_m = -1, first_n = extents_.n, last_n = -1;
    std::size_t left = 0, right = 0, top = 0, bottom = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            if ((state_[extents_.index(m, n)] & kPart) == 0) continue;
            first_m = std::min(first_m, m), last_m = std::max(last_m, m);
            first_n = std::min(first_n, n), last_n = std::max(last_n, n);
            left += m == 0 ? 1 : 0, right += m == extents_.m - 1 ? 1 : 0;
            top += n == 0 ? 1 : 0, bottom += n == extents_.n - 1 ? 1 : 0;
        }
    }
    const std::size_t across = std::min(left, right), down = std::min(top, bottom);
    std::size_t cut = left + right + top + bottom - 2 * std::max(across, down);
    if (tube_) cut = tube_->along_columns() ? top + bottom - 2 * down : left + right - 2 * across;
    const int longer = std::max(last_m - first_m, last_n - first_n) + 1;
    return static_cast<double>(cut) * longer / static_cast<double>(found_.area);
}

// Turned by 180 degrees about its centroid. An image beyond the field is not known. What is missing opposite each other
// is not seen.
bool RimFinder::lacks_image() {
    const Centroid middle = centroid();
    const auto is_inside = [&](int m, int n) { return (state_[extents_.index(m, n)] & kInside) != 0; };
    return has_square([&](int m, int n) {
        const int x = middle.twice_m - m, y = middle.twice_n - n;
        return is_inside(m, n) && x >= 0 && y >= 0 && x < extents_.m && y < extents_.n && !is_inside(x, y);
    });
}

// The hull of an outline is exact to a lenslet or two: a square of default_rim_margin() + 1 lenslets shows more.
template <class Lenslet>
bool RimFinder::has_square(Lenslet&& of) {
    const int side = default_rim_margin(extents_) + 1;
    std::ranges::fill(in_column_, std::int16_t{0});  // lenslets of it in a row down to this one
    for (int n = 0; n < extents_.n; ++n) {
        int beside = 0;
        for (int m = 0; m < extents_.m; ++m) {
            std::int16_t& above = in_column_[static_cast<std::size_t>(m)];
            above = static_cast<std::int16_t>(of(m, n) ? above + 1 : 0);
            beside = above >= side ? beside + 1 : 0;
            if (beside >= side) return true;
        }
    }
    return false;
}

}  // namespace hord::algo
