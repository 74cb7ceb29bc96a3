// From a frame to a verdict: decode, HORD, features, defects.
//
// A Pipeline is used by one thread at a time. create() allocates; inspect() streams rows through a window of three HORD
// rows a thread, which stays in cache, and allocates only in the search for defects. No I/O, no clock, no logging.
// The results do not depend on the number of threads, to the bit.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "algo/frame/extents.h"
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
// other threads counts as feature time.
struct StageTimes {
    std::int64_t decode_ns = 0, hord_ns = 0, feature_ns = 0, decide_ns = 0, total_ns = 0;
};
using NowNs = std::int64_t (*)();

struct Inspection {
    Verdict verdict = Verdict::unfit;
    Reason reason = Reason::nothing_to_see;
    float score = 0;                      // the worst value over its limit: >= 1 rejects
    bool bounded = false;                 // the work budget ran out: some values are upper bounds, the verdict is safe
    std::uint32_t dark_dn = 0;            // DN, the level that was subtracted from every sample of this frame
    FrameFindings frame;                  // what the checks of the whole frame found
    std::span<const Defect> defects;      // largest peak first
    std::optional<Feature> compares;      // the distance between neighbours that the recipe chooses
    Map gradient;                         // the gradient of that distance, in its unit (unit_of)
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
    Registered registered;
    StageTimes times;
};

enum class MapSet : std::uint8_t {
    judged,  // the maps that the verdict needs
    all,     // also the Jacobian's norms and the transmission
};

class Pipeline {
  public:
    // Fails with invalid_argument if the extents, the recipe or the number of threads are invalid (all problems of a
    // recipe in one message), with busy if the system cannot start a thread. `threads` includes the calling one.
    static Result<Pipeline> create(const Extents& extents, int bits, const Recipe& recipe, int threads = 1,
                                   MapSet maps = MapSet::judged);

    // Inspects one macro-pixel frame. The spans in the result stay valid until the next call.
    // Fails with invalid_argument if the frame's size or bit depth is not that given to create().
    Result<Inspection> inspect(const FrameView& frame, NowNs now = nullptr);

  private:
    struct Workspace;
    explicit Pipeline(common::Opaque<Workspace> workspace) : workspace_(std::move(workspace)) {}
    common::Opaque<Workspace> workspace_;
};

}  // namespace hord::algo
