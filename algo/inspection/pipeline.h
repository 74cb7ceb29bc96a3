// From a frame to a verdict: decode, HORD, features, defects.
//
// The EMD between neighbours is bounded for every lenslet and solved where the verdict needs its value, within a budget
// (docs/notes/inspection.md, "Bounded time"). The time of a frame is bounded, whatever it shows.
//
// A Pipeline is used by one thread at a time. create() allocates; inspect() streams rows through a window of three HORD
// rows a thread, which stays in cache, and allocates only in the search for defects. No I/O, no clock, no logging.
// The results do not depend on the number of threads, bit for bit, unless time runs out (InspectionLimits::time_ns).
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "algo/frame/extents.h"
#include "algo/frame/grid_decoder.h"
#include "algo/frame/mask.h"
#include "algo/inspection/frame_findings.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/registration.h"
#include "algo/verdict/verdict.h"
#include "common/frame.h"
#include "common/opaque.h"

namespace hord::algo {

// One value a lenslet, row by row; empty if the recipe does not choose the feature. Always finite. 0 where there is no
// value: gradients at kDark, kSaturated and kBorder lenslets, transmission at kSaturated ones (not at dark ones, whose
// transmission is their missing light).
using Map = std::span<const float>;

// Time of the calling thread in each stage, in ticks of the clock given to inspect(); 0 without a clock. Waiting for
// other threads counts as part of the stage that waits.
struct StageTimes {
    std::int64_t resample_ns = 0;  // raw samples to macro-pixels; 0 where a frame has them
    std::int64_t decode_ns = 0, hord_ns = 0, feature_ns = 0;
    std::int64_t register_ns = 0, compare_ns = 0;  // with a reference: the pose, and the comparison of every lenslet
    std::int64_t bound_ns = 0;                     // bounds of the EMD
    std::int64_t decide_ns = 0, total_ns = 0;
};
using NowNs = std::int64_t (*)();

// Limits of the work that a verdict by the EMD may take beside the bounds. A unit of work is about a nanosecond of one
// core (algo/inspection/exact_gradients.cpp). When a limit is reached, the upper bounds of the lenslets that are left
// are judged: a part may then be rejected that would pass, never the other way round.
struct InspectionLimits {
    std::int64_t work_a_lenslet = 15, work = 50'000;  // of a frame: lenslets times the first, plus the second
    std::int64_t time_ns = 0;  // by the clock given to inspect(), since its call; 0, or without a clock: no limit
};

// Scores up to this are told as 0. On flat light without noise nearly all lenslets have the same tiny value, and the
// search for the largest one would solve them all.
constexpr float kInsignificantScore = 0.02F;

// Numbers of lenslets.
struct LensletCounts {
    std::size_t judged = 0;              // inside the part and its zones, the rim left out
    std::size_t lit = 0, saturated = 0;  // of these: with light enough for a HORD (saturated ones too); saturated
};

// A sample that stands alone in the worst defect: far above the dark level, and all samples around it at that level.
// Light makes spots of several bins, so that a pixel of the sensor may be warm. Not seen where raw frames are resampled
// into bins that share the pixel.
struct LoneSample {
    int x = 0, y = 0;      // column and row in Inspection::macro_pixels, samples
    std::uint32_t dn = 0;  // above the dark level; 0: there is none
};

struct Inspection {
    FrameView macro_pixels;  // the frame that was given, or, of a raw one, what was decoded from it
    Verdict verdict = Verdict::unfit;
    Reason reason = Reason::nothing_to_see;
    float score = 0;  // the worst value over its limit: >= 1 rejects; 0: <= kInsignificantScore
    // With a reference: `score` by lenslets and their regions alone; and the score of what several lenslets show
    // together (algo/reference/pooled_scores.h), standard deviations; 0 where it is not judged.
    float by_lenslets = 0, together = 0;
    bool bounded = false;                 // a limit was reached: score, defects and peaks may be upper bounds
    bool out_of_time = false;             // it was the limit of time: another run may give other values
    std::uint32_t dark_dn = 0;            // DN, the level that was subtracted from every sample of this frame
    FrameFindings frame;                  // what the checks of the whole frame found
    LensletCounts lenslets;               // of the part
    LoneSample lone_sample;               // of a rejected part
    std::span<const Defect> defects;      // largest peak first
    std::optional<Feature> compares;      // the distance between neighbours that the recipe chooses
    Map gradient;                         // the gradient of that distance, in its unit (unit_of)
    bool has_bounds = false;              // `gradient` holds upper bounds where the verdict needs no value (MapSet)
    Map emd;                              // the same map if it is the EMD, bin pitches; else empty
    Map frobenius;                        // bin pitches a lenslet
    Map transmission;                     // 1 is the part's typical lenslet
    Map spectral;                         // empty unless MapSet::all: the Jacobian's other norms, bin pitches a lenslet
    Map nuclear;                          //
    Map anisotropy;                       // 0..1: how much the Jacobian has one direction (algo/features/jacobian.h)
    std::span<const std::uint8_t> mask;   // MaskBit, one a lenslet
    std::span<const std::uint32_t> sums;  // DN above dark_dn, one a lenslet, for every recipe
    // With a reference: the worst score of a lenslet, in units of noise (algo/inspection/reference_defects.h), and the
    // pose of the part. Else empty.
    Map z_score;
    std::span<const std::uint8_t> compared;  // MapSet::all: 0 where the reference has nothing to compare with
    Registered registered;
    StageTimes times;
};

enum class MapSet : std::uint8_t {
    judged,  // the maps that the verdict needs. The EMD gradient is exact where the verdict needs its value (all
             // flagged lenslets, and the one that gives the score), an upper bound elsewhere, and 0 where it is not
             // judged: not a map to show or to store
    exact,   // the same maps; the EMD gradient is exact everywhere. No limit of work or time
    all,     // also the Jacobian's norms and the transmission; otherwise as exact
};

// Whether parts can be judged by the recipe on these light fields. Fails with invalid_argument: all problems in one
// message, with the recipe's name; a reference of other light fields alone.
Result<void> check_recipe(const Recipe& recipe, const Extents& extents, int bits);

class Pipeline {
  public:
    // Fails with invalid_argument if the extents, the recipe or the number of threads are invalid (all problems of a
    // recipe in one message), with busy if the system cannot start a thread. `threads` includes the calling one.
    static Result<Pipeline> create(const Extents& extents, int bits, const Recipe& recipe, int threads = 1,
                                   MapSet maps = MapSet::judged);

    // The same for raw frames of a calibrated sensor. Rows are decoded by the threads that use them, while they are in
    // cache. The results are those of the frame that decoder.decode() gives.
    static Result<Pipeline> create(const GridDecoder& decoder, int bits, const Recipe& recipe, int threads = 1,
                                   MapSet maps = MapSet::judged);

    // Inspects one frame, of macro-pixels or raw as create() was told. The spans in the result stay valid until the
    // next call. Fails with invalid_argument if the frame's size or bit depth is not that given to create().
    Result<Inspection> inspect(const FrameView& frame, NowNs now = nullptr, const InspectionLimits& limits = {});

  private:
    struct Workspace;
    static Result<Pipeline> create(const Extents& extents, int bits, const Recipe& recipe, int threads, MapSet maps,
                                   const GridDecoder* decoder);
    explicit Pipeline(common::Opaque<Workspace> workspace) : workspace_(std::move(workspace)) {}
    common::Opaque<Workspace> workspace_;
};

}  // namespace hord::algo
