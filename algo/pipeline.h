// From a frame to a judgement: decode, HORD, features, defects, verdict.
//
// One Pipeline belongs to one thread. All memory is taken in create(); inspect() streams rows through a
// workspace that stays in cache and allocates nothing outside the blob search. No I/O, no clock, no logging.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "algo/frame.h"
#include "algo/light_field.h"
#include "algo/mask.h"
#include "algo/recipe.h"
#include "algo/verdict.h"

namespace hord::algo {

// One value a lenslet, row by row. Never NaN, never infinite. 0 where `mask` says there is no value: the gradients
// at kDark, kSaturated and kBorder lenslets, the transmission at kSaturated ones (a dark lenslet has one: its missing light).
using Map = std::span<const float>;

// Time spent in each stage, in the ticks of the clock given to inspect(); 0 without one.
struct StageTimes {
    std::int64_t decode_ns = 0, hord_ns = 0, feature_ns = 0, decide_ns = 0, total_ns = 0;
};
using NowNs = std::int64_t (*)();

struct Inspection {
    Verdict verdict = Verdict::unfit;
    Reason reason = Reason::nothing_to_see;
    float score = 0;                     // the worst value over its limit: >= 1 rejects
    std::span<const Defect> defects;     // largest peak first
    Map emd;                             // bin pitches
    Map frobenius;                       // bin pitches a lenslet
    Map transmission;                    // 1 is the part's typical lenslet
    std::span<const std::uint8_t> mask;  // MaskBit, one a lenslet
    StageTimes times;
};

class Pipeline {
  public:
    // Fails with invalid_argument when the extents or the recipe are impossible (all problems in one message).
    static Result<Pipeline> create(const Extents& extents, int bits, const Recipe& recipe);

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
