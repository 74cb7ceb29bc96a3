#include "firmware/soak/pipeline_pool.h"

namespace hord::firmware {

Result<std::unique_ptr<PipelinePool>> PipelinePool::make() {
    sim::Scene good;
    good.name = "good";
    good.camera.extents = {24, 24, 7, 7};
    good.part = sim::DoubleConvexLens{};
    sim::Scene bad = good;
    bad.name = "speck";
    bad.defects.push_back(sim::AbsorbingSpeck{.centre_mm = {0, 0, 0}, .radius_mm = 2, .transmission = 0});
    auto frames = sim::RenderedFrames::make({good, bad}, {.exposures = 4, .nominal_share = 0.02, .seed = 1, .progress = {}});
    if (!frames) return tl::unexpected(frames.error());
    auto pool = std::unique_ptr<PipelinePool>(new PipelinePool);
    pool->frames_ = std::move(*frames);
    pool->settings_.extents = good.camera.extents;
    pool->settings_.bits = pool->frames_->format().bits;
    return pool;
}

void PipelinePool::equip(LineOptions& line) const {
    line.frames = frames_.get();
    line.inspector = [settings = settings_, modelled = line.inspection](hal::EventLoop& loop) { return make_inline_inspector(loop, settings, modelled); };
}

}  // namespace hord::firmware
