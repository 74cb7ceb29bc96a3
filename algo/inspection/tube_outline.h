// The outline of a hollow body (vial, syringe, tube): two straight outer edges, a flank along each, and the band of
// light between the flanks. The axis runs roughly along a column or a row. The steps and their constants:
// docs/notes/inspection.md.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"

namespace hord::algo {

// One frame, one value a lenslet, row by row. `mask`: kDark and kSaturated are used.
struct FieldLight {
    std::span<const Deflection> deflections;
    std::span<const std::uint32_t> sums;
    std::span<const std::uint8_t> mask;
};

// The slope of the mean deflection that a tube has along its whole length and on both sides of its axis: how much more
// than a smooth part's it may be at a lenslet. 0 where it is none.
struct OwnSlope {
    float bins = 0;     // bin pitches a lenslet, across the axis
    float squared = 0;  // what the squared norm of the Jacobian changes by if this slope is taken off
};

class TubeOutline {
  public:
    // margin: lenslets beside a flank's usual inner edge that are flank, too. steepest_bins: slope of the mean
    // deflection across the axis, bin pitches a lenslet, from which a lenslet beside the flank belongs to it; 0: no
    // slope does. Allocates all memory.
    TubeOutline(const Extents& extents, int margin, float steepest_bins);

    // `state` holds outline::kPart at the lenslets of the outline. If there is a tube of at least 1/kSmallestPart of
    // the field, it gets kPart and kInside everywhere inside the tube and nowhere else, and kFlank on the flanks. Else
    // nothing changes. Returns whether there is one.
    bool find(const FieldLight& light, std::span<std::uint8_t> state);

    // Of the last tube: its axis runs along the columns, else along the rows; both sides have a flank.
    [[nodiscard]] bool along_columns() const { return along_columns_; }
    [[nodiscard]] bool has_flanks() const { return sides_[0].thickness > 0 && sides_[1].thickness > 0; }
    // In half of the lines across or more, both flanks have a lenslet with less than half of the band's light.
    [[nodiscard]] bool has_dark_flanks() const { return has_dark_flanks_; }
    // Of the last frame, one a lenslet.
    [[nodiscard]] std::span<const OwnSlope> own_slopes() const { return own_slopes_; }

  private:
    // The field with u along the axis, and v across it, counted from one of the two sides.
    struct View {
        Extents e;
        bool along_columns = true, from_far_side = false;
        [[nodiscard]] int length() const { return along_columns ? e.n : e.m; }
        [[nodiscard]] int width() const { return along_columns ? e.m : e.n; }
        [[nodiscard]] std::size_t at(int u, int v) const {
            const int w = from_far_side ? width() - 1 - v : v;
            return along_columns ? e.index(w, u) : e.index(u, w);
        }
    };
    struct Line {
        std::int64_t offset = 0, slope = 0;  // 2^-16 lenslets
        [[nodiscard]] int operator()(int u) const {
            return static_cast<int>((offset + slope * u + (std::int64_t{1} << 15)) >> 16);
        }
    };
    struct Side {
        std::vector<int> edge;    // v of the first lenslet of the outline in each line across, from this side; -1: none
        Line line;                // straight through most of the edge
        int first = 0, last = 0;  // u: ends of the edge that follows the line
        int thickness = 0;        // of the flank, lenslets
    };

    void find_edges(View view, std::span<const std::uint8_t> state);
    void find_typical_light(View view, const FieldLight& light);
    [[nodiscard]] bool is_flank(View view, const FieldLight& light, int u, int v, bool steep_too) const;
    [[nodiscard]] std::int64_t change_across(View view, const FieldLight& light, int u, int v) const;
    [[nodiscard]] bool find_dark_flanks(View view, const FieldLight& light) const;
    [[nodiscard]] int lines_with_flanks(View view, const FieldLight& light) const;
    bool fit_line(View view, Side& side);
    [[nodiscard]] bool find_straight(View view, Side& side) const;
    [[nodiscard]] int thickness(View view, const FieldLight& light, const Side& side, bool steep_too) const;
    void find_flanks(View view, const FieldLight& light);
    void find_ends(View view);
    std::size_t enclose(View view);
    [[nodiscard]] std::int64_t typical_change(View view, const FieldLight& light, const Side& side, int depth);
    void find_own_slopes(View view, const FieldLight& light);

    Extents extents_;
    int margin_;
    std::int64_t steepest_;  // over two lenslets, raw DeflectionQ; 0: no limit
    std::array<Side, 2> sides_;
    bool along_columns_ = true, has_dark_flanks_ = false;
    int width_ = 0;                  // of the tube, lenslets
    std::uint32_t typical_ = 0;      // light of the band, DN
    std::vector<int> first_, last_;  // u of the tube's ends at each v
    std::vector<int> present_;       // u of the lines across in which the outline is seen
    std::vector<std::int64_t> values_;
    std::vector<std::uint32_t> scratch_;
    std::vector<std::uint8_t> body_;  // kInside, kFlank
    std::vector<OwnSlope> own_slopes_;
};

}  // namespace hord::algo
