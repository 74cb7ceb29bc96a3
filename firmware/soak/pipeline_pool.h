// The full pipeline in place of tokens and stand-in: frames of a rendered pool, judged as in the service.
//
// A small camera (24 x 24 lenslets of 7 x 7 bins), a clear lens and one with a speck; rendered once. What it judges is
// detection's business: a miss is counted, not held against the control.
#pragma once

#include <memory>

#include "firmware/soak/simulated_line.h"
#include "hal_sim/cell/rendered_frames.h"

namespace hord::firmware {

class PipelinePool {
  public:
    static Result<std::unique_ptr<PipelinePool>> make();
    void equip(LineOptions& line) const;  // the pool outlives the line

  private:
    PipelinePool() = default;
    std::unique_ptr<sim::RenderedFrames> frames_;
    InspectorSettings settings_;
};

}  // namespace hord::firmware
