// Checks of a whole frame: can it be judged at all? Is its light that of a collimated source in the middle of the bins,
// do its macro-pixels have the size that was said, and does it show one whole part? A frame that shows nothing, or
// something that is not understood, must not pass. Each rule with its limits and reasons: docs/notes/inspection.md.
//
// Before decoding: the light levels for this frame. After the part was looked for: the verdict on the frame.
// All memory is allocated by the constructor. Deterministic: sums of integers, and doubles in a fixed order.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/frame/decode.h"
#include "algo/inspection/frame_findings.h"
#include "algo/inspection/known_dark_bins.h"
#include "algo/inspection/rim.h"
#include "algo/light/dark_bins.h"
#include "algo/light/exposures.h"
#include "algo/light/light_scale.h"
#include "algo/light/macro_period.h"
#include "algo/light/mean_spot.h"
#include "algo/recipe/recipe.h"
#include "algo/verdict/verdict.h"

namespace hord::algo {

constexpr double kMaxBorderCut = 0.5;     // outermost lenslets of the part over the diameter of a disc of its area;
                                          // of a plate those without others opposite them, over its width
constexpr double kMinSharpOutline = 0.5;  // of the part's outline
constexpr double kMinFreeBeside = 0.5;    // of a row or column beside the part
// Of the light may be lost to the dark level. Beyond it light that is even can vary by kJumpLight where it is spread
// over more or fewer bins, and an outline is no longer known by its light.
constexpr double kMaxLostLight = 1 - 1 / kJumpLight;
constexpr double kMaxAlternationBins = 0.15;  // half the difference of lenslets in turn, bin pitches
constexpr double kMaxAlternationLight = 0.1;  // the same of their light, relative
constexpr double kMaxSplitShare = 1.0 / 16;   // of the judged lenslets
constexpr double kMaxLight = 2.5;  // light of a lenslet of the part over that of free light; a part focuses some
constexpr double kMaxGlareShare = 1.0 / 64;  // of the judged lenslets may exceed it: the edge of a cut does
constexpr double kMaxAddedSpread = 0.5;   // bin pitches rms along each axis, behind a plate beside that of free light
constexpr double kMinFogSigmas = 5;       // of the dark bins' noise, by which those beside a plate read more
constexpr double kMaxSpotOfEven = 0.95;   // of the width of evenly lit bins
constexpr double kMinShadedShare = 0.75;  // of the steps across a plate's edges, where little light is deflected
constexpr double kMinDeflectingShare = 0.25;  // of the inside of a part, and of the lit lenslets in an opaque holder

// Least overlap of a part's outline and its image turned by 180 degrees, over both together. A part of few lenslets has
// a coarse outline. `area`: lenslets.
double min_symmetry(std::size_t area);
// Least share that a part covers of its convex hull.
double min_convexity(std::size_t area);

// A decoded frame, one value a lenslet, row by row. `mask`: kDark and kSaturated are read.
struct DecodedField {
    std::span<const Deflection> deflections;
    std::span<const std::uint32_t> sums;
    std::span<const std::uint8_t> mask;
};

class FrameChecks {
  public:
    // Keeps what it needs of the recipe, and of its reference where the free light lies.
    FrameChecks(const Extents& extents, int bits, const Recipe& recipe);

    // The light levels for this frame: the recipe's, with the dark level raised to the frame's own dark bins, and where
    // it is the reference's, to the bins that the reference knows to be dark. Reads the lenslets that
    // for_each_sampled() visits.
    LightLevels levels_of(const FrameView& frame);
    template <class Visit>
    void for_each_sampled(Visit&& visit) const {
        dark_bins_.for_each_sampled(visit);
    }

    // What the dark level leaves of the free light beside the part. levels_of() was called with this frame.
    LightScale scale_of(const FrameView& frame, const FoundPart& part);

    // Reason::unexpected_geometry, unexpected_light or no_part; none if the frame can be judged. levels_of() was called
    // with this frame; `field` was decoded with its result. `alternation`: of the whole field.
    Reason judge(const FrameView& frame, const DecodedField& field, const FoundPart& part,
                 const Alternation& alternation);

    // The form of the part says what its outline is: pieces that are missing at it are asked of judge_good().
    [[nodiscard]] bool has_known_outline() const { return part_required_ && !has_reference_ && symmetric_; }

    // Of a frame that was judged, and of a part without a defect: Reason::no_part if its outline lacks a piece that
    // hides nothing of the rest, or a piece lies outside the field; none if not. (A defect is told with its place
    // instead.)
    Reason judge_good(const FoundPart& part);
    // Of a part that a reference recognises, and into which the free light goes on.
    Reason judge_open_outline();

    // The light repeats with another period than the macro-pixels. Of frames that are too dark or show nothing to
    // judge: wrong macro-pixels do.
    bool has_other_period(const FrameView& frame);

    // Of the last frame.
    [[nodiscard]] const FrameFindings& findings() const { return findings_; }

  private:
    FrameFault check_light(const FrameView& frame, const DecodedField& field, const FoundPart& part,
                           const Alternation& alternation);
    double second_share_of_places(const FrameView& frame, const DecodedField& field, const FoundPart& part);
    // Of the judged lenslets, those far brighter than the median of the chosen ones.
    double glare_share(const DecodedField& field);
    // Of the chosen lenslets.
    double median_light(const DecodedField& field);
    [[nodiscard]] double lost_share(const DecodedField& field, const MeanSpot& spot) const;
    [[nodiscard]] bool is_dim() const { return static_cast<double>(findings_.lost_share) > kMaxLostLight; }
    FrameFault check_exposures(const FrameView& frame, const DecodedField& field, const Alternation& alternation);
    [[nodiscard]] double surely_deflecting(const DecodedField& field, const FoundPart& part) const;
    [[nodiscard]] bool deflects() const { return static_cast<double>(findings_.deflecting) >= kMinDeflectingShare; }
    FrameFault check_part(const DecodedField& field, const FoundPart& part);
    [[nodiscard]] FrameFault check_plate(const FoundPart& part) const;
    [[nodiscard]] bool must_be_whole() const;  // a plate or a tube
    [[nodiscard]] bool is_cut_by_field() const { return static_cast<double>(findings_.border_cut) > kMaxBorderCut; }
    FrameFault check_spread(const FrameView& frame, const DecodedField& field, const FoundPart& part);
    bool is_fog_beside(const DecodedField& field, const FoundPart& part);
    FrameFault check_holder(const DecodedField& field) const;
    // The turn of the outermost lenslets' light about the field's middle, rad; 0 where it does not follow a plane.
    [[nodiscard]] double turn_of_bins(const DecodedField& field) const;
    template <class Suits>
    void choose_lenslets(std::size_t lenslets, std::size_t most, Suits suits);
    void expect_light_of_reference(const Reference& reference);
    Deflection median_of_chosen(const DecodedField& field);

    Extents extents_;
    LightLevels levels_;
    std::uint32_t max_dark_rise_dn_, dark_dn_ = 0;
    DarkLevel dark_level_;
    float max_offset_bins_, max_spot_bins_, max_second_share_;
    PartForm form_;
    bool check_period_, part_required_, symmetric_, has_reference_;
    double expected_x_ = 0, expected_y_ = 0;  // of the free light, bin pitches
    FrameFault fault_of_dark_ = FrameFault::none;
    DarkBinMeter dark_bins_;
    KnownDarkBins known_dark_;  // where the dark level is the reference's
    MacroPeriodFinder period_;
    MacroPeriod period_of_reference_;
    std::vector<std::uint32_t> chosen_;  // lenslets whose light is measured
    std::vector<std::int64_t> scratch_;
    FrameFindings findings_;
};

}  // namespace hord::algo
