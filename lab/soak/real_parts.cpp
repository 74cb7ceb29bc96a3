#include "lab/soak/real_parts.h"

#include <memory>
#include <mutex>

#include "hal_sim/cell/production.h"
#include "hal_sim/cell/rendered_frames.h"

namespace hord::lab {
namespace {

constexpr int kLenslets = 24;
constexpr double kShare = kLenslets / 111.0;  // of the full field and lens
constexpr std::uint64_t kPoolSeed = 24;

struct Pool {
    sim::Production production;
    std::unique_ptr<sim::RenderedFrames> frames;
    algo::Extents extents;
    int bits = 8;
};

Result<Pool> render_pool() {
    sim::ProductionOptions options;
    sim::Scene& scene = options.clean;
    scene.name = "lens";
    sim::DoubleConvexLens lens;
    lens.aperture_radius_mm *= kShare;
    scene.part = lens;
    scene.camera.extents = {kLenslets, kLenslets, 9, 9};
    scene.camera.field_mm *= kShare;
    scene.noise.electrons_per_dn = 40;
    scene.noise.read_e = 2;
    scene.noise.dark_dn = 1;
    options.seed = kPoolSeed;
    options.good_parts = 3;
    options.of_each_defect = 1;
    options.good_share = 0.9;
    options.wobble_mm *= kShare;
    auto drawn = sim::draw_production(options);
    if (!drawn) return tl::unexpected(drawn.error());
    auto frames = sim::RenderedFrames::make(drawn->scenes,
                                            {.exposures = 4, .nominal_share = 0.02, .seed = kPoolSeed, .progress = {}});
    if (!frames) return tl::unexpected(frames.error());
    return Pool{std::move(*drawn), std::move(*frames), scene.camera.extents, scene.camera.bits};
}

}  // namespace

Result<void> show_real_parts(LineOptions& line) {
    static std::mutex mutex;
    static std::unique_ptr<Pool> pool;  // shared by all lines; constant once it is rendered
    {
        const std::lock_guard lock(mutex);
        if (pool == nullptr) {
            auto rendered = render_pool();
            if (!rendered) return tl::unexpected(rendered.error());
            pool = std::make_unique<Pool>(std::move(*rendered));
        }
    }
    auto judge = make_pipeline_judge({.extents = pool->extents, .bits = pool->bits, .recipe = {}});
    if (!judge) return tl::unexpected(judge.error());
    line.cell.schedule.kinds = pool->production.kinds;
    line.frames = pool->frames.get();
    line.judge = std::move(*judge);
    return {};
}

}  // namespace hord::lab
