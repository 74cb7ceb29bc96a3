// From a frame to a judgement: decode, HORD, features, defects, verdict.
//
// One Pipeline belongs to one thread. All memory is taken in create(); inspect() streams rows through a
// workspace of three HORD rows a thread, which stays in cache, and allocates nothing outside the blob search. No I/O,
// no clock, no logging. A lenslet's values do not depend on the number of threads, to the bit.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "algo/frame/extents.h"
#include "algo/frame/mask.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/registration.h"
#include "algo/verdict/verdict.h"
#include "common/frame.h"

namespace hord::algo {

// One value a lenslet, row by row; empty where the recipe does not choose the feature. Never NaN, never infinite. 0
// where `mask` says there is no value: the gradients at kDark, kSaturated and kBorder lenslets, the transmission at
// kSaturated ones (a dark lenslet has one: its missing light).
using Map = std::span<const float>;

// Time spent in each stage by the calling thread, in the ticks of the clock given to inspect(); 0 without one. Waiting
// for other threads counts as feature time.
struct StageTimes {
    std::int64_t decode_ns = 0, hord_ns = 0, feature_ns = 0, decide_ns = 0, total_ns = 0;
};
using NowNs = std::int64_t (*)();

struct Inspection {
    Verdict verdict = Verdict::unfit;
    Reason reason = Reason::nothing_to_see;
    float score = 0;                     // the worst value over its limit: >= 1 rejects
    std::span<const Defect> defects;     // largest peak first
    std::optional<Feature> compares;     // by which distance neighbours are compared: the recipe's choice
    Map gradient;                        // that distance's, in its unit (unit_of)
    Map emd;                             // the same where it is the EMD: bin pitches; else empty
    Map frobenius;                       // bin pitches a lenslet
    Map transmission;                    // 1 is the part's typical lenslet
    Map spectral;                        // empty unless MapSet::all: the Jacobian's other norms, bin pitches a lenslet
    Map nuclear;                         //
    Map anisotropy;                      // 0..1: how much the Jacobian has one direction (algo/features/jacobian.h)
    std::span<const std::uint8_t> mask;  // MaskBit, one a lenslet
    std::span<const std::uint32_t>
        sums;               // DN, one a lenslet: its light above the dark level, whatever the recipe chooses
    Map z_score;            // with a reference: the worst score of a lenslet, in units of noise
                            // (algo/inspection/reference_defects.h); else empty
    Registered registered;  // and where the part lies
    StageTimes times;
};

enum class MapSet : std::uint8_t {
    judged,  // what the verdict needs
    all,     // and the Jacobian's norms and the transmission, judged or not
};

class Pipeline {
  public:
    // Fails with invalid_argument when the extents, the recipe or the number of threads are impossible (all problems of
    // a recipe in one message), with busy when the system gives no thread. `threads` includes the calling one.
    static Result<Pipeline> create(const Extents& extents, int bits, const Recipe& recipe, int threads = 1,
                                   MapSet maps = MapSet::judged);

    // Judges one macro-pixel frame. The spans in the answer stay valid until the next call.
    // Fails with invalid_argument when the frame's size or bit depth is not what create() was told.
    Result<Inspection> inspect(const FrameView& frame, NowNs now = nullptr);

    Pipeline(Pipeline&&) noexcept;
    Pipeline& operator=(Pipeline&&) noexcept;
    ~Pipeline();

  private:
    struct Workspace;
    explicit Pipeline(std::unique_ptr<Workspace> workspace);
    std::unique_ptr<Workspace> workspace_;
};

}  // namespace hord::algo
