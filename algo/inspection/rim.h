// Finds the part in the field and masks its rim, which has large gradients (half-covered lenslets, side walls, the jump
// to the undisturbed light) and is not judged. How disturbed a lenslet inside the part is does not matter: a bubble or
// a cut cannot be mistaken for the rim. What is part and what is field follows the recipe's form of part
// (algo/recipe/recipe.h). The steps for each form, the choice of the margin and the limits of the rules:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/extents.h"
#include "algo/frame/flood.h"
#include "algo/inspection/field_circle.h"
#include "algo/inspection/field_rectangle.h"
#include "algo/inspection/plate_outline.h"
#include "algo/inspection/row_hull.h"
#include "algo/inspection/tube_outline.h"
#include "algo/light/light_scale.h"
#include "algo/recipe/recipe.h"

namespace hord::algo {

constexpr double kFreeToleranceBins = 0.25;  // deflection of free light from the median of the outermost lenslets
constexpr int kSmallestPart = 16;            // a part covers at least 1/kSmallestPart of the field
constexpr double kJumpBins = 0.25;           // light jumps between two lenslets if its mean deflection changes by more
constexpr double kJumpLight = 1.25;          // or its sum by more than this factor
constexpr int kMaxEdgeWidth = 2;             // lenslets that an edge in focus covers in part: two if it lies askew
constexpr int kMinBeside = 8;                // lenslets beside the part in a row or column that tell something
constexpr double kShadedLight = 0.985;       // of the light outside an edge; glass reflects 0.04 at each face or more
constexpr double kSmoothChange = 2;          // a shadow changes across an edge at most so much more than beside it
constexpr double kFarthestExtrapolated = 2;  // times the distance over which a change of light was seen
constexpr int kMinShadedSteps = 8;           // steps across a plate's edges that tell something
constexpr std::size_t kDustOfPart = 64;      // an island beside the part below 1/kDustOfPart of its area is dust

// What mark() found. `parts`: regions of at least 1/kSmallestPart of the field. Regions between which the light changes
// smoothly count once: the two flanks of a cylinder lens, whose middle shows free light. A tube or a plate is 1. A web
// is 0, because it is not looked for.
struct FoundPart {
    // The outermost lenslets show free light. Without it there are no parts, except a tube that its flanks show.
    bool free_light = false;
    bool lacks_flanks = false;  // the edges of a tube were found, but not a flank on both sides
    int parts = 0;
    // Islands in the free field beside the part, of at least 1/kDustOfPart of its area, that let light through: smaller
    // parts. Dust is opaque.
    int islands = 0;
    std::size_t area = 0;       // lenslets of all parts
    std::size_t at_border = 0;  // of these, outermost lenslets of the field
    double sharp_outline = 0;   // share of the outline, in steps from lenslet to lenslet, where the light jumps
    // Share of the lenslets beside the part that show free light, in the row or the column with the fewest. It counts
    // rows with at least kMinBeside lenslets beside the part, and those without any free light; 1 if there is no part.
    double free_beside = 1;
    // Set by measure_edges(): lenslets along a row or a column in which undeflected light falls from that of the free
    // field to the part's edge: the median. 0 where too little is seen.
    int edge_width = 0;
    // Overlap of the part, with what it encloses, and its image turned by 180 degrees about its centroid, over both
    // together: 1 for a disc or a rectangle, 0.69 for half a disc.
    double symmetry = 0;
    // Of a plate or a tube that the field cuts: lenslets along the cut, over its width. What lies on opposite sides of
    // the field is taken off each other: one that reaches from border to border has no cut.
    double cut = 0;
    // Set by look_for_missing_pieces(). `lacks_place`: the outline is not what the form explains: of a plate neither a
    // rectangle, nor one whose corners are cut alike, nor the same turned by 180 degrees; of a plate or a round part
    // whose outline is a circle in most places, it lies inside the circle in others. `notched`: at a plate's outline
    // the light outside goes on inside.
    bool lacks_place = false, notched = false;
    // Lenslets of the part, with what it encloses, over those of its convex hull: 1 for a disc or a rectangle.
    double convexity = 0;
    double light_beside = 0;  // DN: mean free light outside the edges of a plate; 0 where too little is seen
    // Of a plate: share of the steps across its edges, along rows and columns, at which the undeflected light inside is
    // less than kShadedLight of the free light outside; how many steps can be compared; whether the light outside grows
    // away from the edges as that of a soft shadow does; and whether only the middle tells so, because it is as light
    // as the free light: a hole, or nothing between the edges.
    double shaded = 0;
    int shaded_steps = 0;
    bool soft_shadow = false, clear_middle = false;
    // Share of the lenslets inside the part, its rim left out, that deflect light by more than kFreeToleranceBins from
    // the free light or are dark; 1 if nothing is left or there is no part. If no free light is seen around a tube, its
    // place is taken by the median of the lenslets inside.
    double deflecting = 1;
    Deflection free = {};                      // what `deflecting` is measured from
    std::span<const std::uint8_t> state = {};  // one a lenslet, valid until the next mark()

    // Bit of `state`: the lenslet shows free light that is connected to that of the outermost lenslets.
    static constexpr std::uint8_t kFreeField = 4;
};

// The light jumps between lenslets a and b: one is dark, or kJumpBins or kJumpLight is exceeded.
bool jumps(const FieldLight& light, std::size_t a, std::size_t b);
bool jumps_by_light(const FieldLight& light, std::size_t a, std::size_t b);  // kJumpBins does not count

// Lenslets: 1.5 + 1/222 of the longer side of the field, rounded.
int default_rim_margin(const Extents& extents);

class RimFinder {
  public:
    // margin: lenslets, 0..1024. steepest_bins: see TubeOutline. Allocates all memory.
    RimFinder(const Extents& extents, int margin, PartForm form = PartForm::round, float steepest_bins = 0);

    // With the recipe's form, rim_margin and limits.
    static RimFinder of(const Recipe& recipe, const Extents& extents);

    // Adds kRim and kOutside to `mask`, which holds kDark and kSaturated. All spans: one value a lenslet, row by row.
    void mark(std::span<const Deflection> deflections, std::span<const std::uint32_t> sums,
              std::span<std::uint8_t> mask);

    // Of the last mark(), with its light and mask: sets FoundPart::edge_width. `scale`: of the free light.
    void measure_edges(const FieldLight& light, const LightScale& scale);

    // Of the last mark(), with its light and mask: sets what found() says of pieces that are missing at the outline.
    void look_for_missing_pieces(const FieldLight& light);

    // Of the last mark().
    [[nodiscard]] const FoundPart& found() const { return found_; }
    // Of the last mark(), TubeOutline::own_slopes() of the tube; empty where none was found.
    [[nodiscard]] std::span<const OwnSlope> own_slopes() const {
        return tube_ && regions_ > 0 ? tube_->own_slopes() : std::span<const OwnSlope>();
    }

  private:
    using Deflections = std::span<const Deflection>;
    using Sums = std::span<const std::uint32_t>;
    bool find_free_light(const FieldLight& light);
    std::size_t agreeing(const FieldLight& light, std::span<const std::uint32_t> ring);
    void mark_wide();
    void reach_free_field();
    void keep_large_parts();
    void keep_long_regions();
    void find_part(const FieldLight& light);
    void enclose();
    void enclose_hull();
    void open_gaps(const FieldLight& light);
    void close_islands();
    void describe(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask);
    [[nodiscard]] int count_islands(Sums sums, std::span<const std::uint8_t> mask);
    [[nodiscard]] int count_parts(Deflections deflections, std::span<const std::uint8_t> mask);
    [[nodiscard]] double sharp_share(Deflections deflections, Sums sums, std::span<const std::uint8_t> mask) const;
    void compare_across_edges(const FieldLight& light);
    // Sums over the steps across a plate's edges.
    struct LightAcrossEdges {
        int lines = 0;
        double inside = 0, beside = 0, farther = 0, farthest = 0;  // light, inside the edge and outside of it
        double fallen = 0;         // light from `inside` to as far again towards the middle: the median, times lines
        int across = 0, away = 0;  // lenslets from `beside` to `inside` and to `farther`
        int apart = 0;             // from the middle of `beside` to that of `inside`
        int into = 0;              // over which light has `fallen`
        void add(const LightAcrossEdges& line);
    };
    static bool is_shadow(const LightAcrossEdges& sums, double middle);
    // Of what is inside: its lenslets, and twice the column and row of its centroid, rounded.
    struct Centroid {
        std::int64_t area = 0;
        int twice_m = 0, twice_n = 0;
    };
    [[nodiscard]] Centroid centroid() const;
    [[nodiscard]] double light_at_centroid(const FieldLight& light) const;
    [[nodiscard]] double least_free_beside();
    [[nodiscard]] double point_symmetry();
    void find_cut();
    [[nodiscard]] const FieldRectangle& rectangle();
    [[nodiscard]] bool lacks_of_rectangle();
    [[nodiscard]] bool lacks_of_circle();
    // A side of the field: lines from it inwards.
    struct FieldSide {
        int lines = 0, length = 0;
        std::size_t first = 0;  // lenslet
        std::ptrdiff_t along = 0, inwards = 0;
        [[nodiscard]] std::size_t at(int line, int in) const {
            return first + static_cast<std::size_t>(along * line + inwards * in);
        }
    };
    [[nodiscard]] bool has_notch(const FieldLight& light, int depth);
    struct ComparedSide {
        std::size_t first = 0, end = 0;  // of open_lines_
        double through = 0;              // the light behind the edges, of that outside
    };
    [[nodiscard]] ComparedSide compare_lines(const FieldLight& light, const FieldSide& side, int depth);
    [[nodiscard]] bool shows_notch(const ComparedSide& lines, double sigma) const;
    [[nodiscard]] double cut_by_border() const;
    // A row or column from an end of the part inwards: its lenslets before the part, and of it.
    struct LineOfPart {
        std::size_t first = 0;
        std::ptrdiff_t step = 0;  // inwards
        int outside = 0, inside = 0;
        [[nodiscard]] std::size_t at(int in) const { return first + static_cast<std::size_t>(step * in); }
    };
    struct Ramp {
        int begin = 0, end = 0;  // lenslets into the part; negative: before it
    };
    [[nodiscard]] int edge_width(const FieldLight& light, const LightScale& scale);
    [[nodiscard]] int width_of_edge(const FieldLight& light, const LightScale& scale, const LineOfPart& line,
                                    double own_slope) const;
    [[nodiscard]] int width_before_glass(const FieldLight& light, const LightScale& scale, double glass_noise,
                                         const LineOfPart& line) const;
    template <class Lines>
    [[nodiscard]] double noise_of_glass(const FieldLight& light, const LightScale& scale, Lines&& for_each_line);
    [[nodiscard]] std::uint32_t light_of_glass(const FieldLight& light, const LightScale& scale,
                                               const LineOfPart& line) const;
    [[nodiscard]] double bend_of(const FieldLight& light, const LightScale& scale, std::size_t k) const;
    [[nodiscard]] bool is_undeflected(const FieldLight& light, const LightScale& scale, std::size_t k) const;
    [[nodiscard]] Ramp ramp_at_edge(const FieldLight& light, const LineOfPart& line, double own_slope) const;
    template <class Lines>
    [[nodiscard]] double slope_inside(const FieldLight& light, Lines&& for_each_line);
    [[nodiscard]] double deflection_squared(const FieldLight& light, std::size_t k) const;  // from free light, raw
    [[nodiscard]] bool lacks_image();
    template <class Lenslet>
    [[nodiscard]] bool has_square(Lenslet&& of);
    double convexity();
    [[nodiscard]] double deflecting_share(Deflections deflections, std::span<const std::uint8_t> mask) const;
    [[nodiscard]] Deflection median_inside(Deflections deflections, std::span<const std::uint8_t> mask);
    void mark_rim(std::span<std::uint8_t> mask);
    void find_across_outline();
    std::size_t mark_connected(std::uint32_t seed, std::uint8_t through, std::uint8_t mark, Connected connected);
    template <class Visit>
    void for_each_connected(Visit&& visit) const {
        for (const FloodRun& run : std::span(runs_).first(connected_runs_)) {
            for (std::size_t k = run.first; k <= run.last; ++k) visit(k);
        }
    }

    Extents extents_;
    int margin_;
    PartForm form_;
    std::optional<TubeOutline> tube_;    // if the form is a tube
    std::optional<PlateOutline> plate_;  // if it is a plate
    RowHull hull_;
    FieldCircle circle_;
    std::optional<FieldRectangle> rectangle_;  // of the last mark(), if it was asked for
    enum class Sides : std::uint8_t { all, beside_columns, beside_rows } free_sides_ = Sides::all;  // show free light
    std::vector<std::uint8_t> state_;                          // of each lenslet, outline::State
    std::vector<std::uint8_t> region_;                         // number of its large region, from 1, where kPart is set
    std::vector<FloodRun> runs_;                               // of the flood fill,
    std::size_t connected_runs_ = 0;                           // and how many the last one found
    std::vector<std::uint8_t> free_along_;                     // kFree: the lenslet, and those beside it in its row
    std::vector<std::uint32_t> ring_;                          // the outermost lenslets,
    std::vector<std::uint32_t> beside_columns_, beside_rows_;  // and those of two sides: what lies beside a tube
    std::vector<std::int64_t> ring_values_;
    struct Between {  // of each line, the first and the last lenslet of the part; none: last < first
        explicit Between(int lines) : first(static_cast<std::size_t>(lines)), last(first.size()) {}
        [[nodiscard]] bool holds(int line, int at) const {
            return at >= first[static_cast<std::size_t>(line)] && at <= last[static_cast<std::size_t>(line)];
        }
        std::vector<std::int16_t> first, last;
    };
    [[nodiscard]] bool closed_in_row(int m, int n) const { return of_rows_.holds(n, m); }
    [[nodiscard]] bool closed_in_column(int m, int n) const { return of_columns_.holds(m, n); }
    Between of_rows_, of_columns_;
    std::vector<std::int16_t> in_column_, free_in_column_;       // numbers of lenslets
    std::vector<int> first_of_line_;                             // lenslets; -1: no lenslet of the part
    std::vector<double> open_lines_, glass_lines_, deviations_;  // light over that outside, of lines across an edge
    std::vector<std::uint8_t> in_rim_, seen_;                    // of the lenslets of a row
    Deflection free_;                                            // median of the outermost lenslets,
    std::int64_t free_light_ = 0;                                // and of their light, DN
    int regions_ = 0;
    FoundPart found_;
};

}  // namespace hord::algo
