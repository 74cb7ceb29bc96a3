// Rendered frames: one light field for each kind of part, exposed with the light of the simulated strobe.
//
// make() renders, and takes a few exposures of each kind at nominal light. These are lent unchanged, so delivering a
// frame takes no time on the loop. Frames with other light, or of a part off the centre, are exposed on demand.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "common/result.h"
#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/world/frame_source.h"

namespace hord::sim {

struct RenderedFramesOptions {
    int exposures = 4;            // of each kind at nominal light, each with its own noise
    double nominal_share = 0.02;  // light within this of 1 counts as nominal
    std::uint64_t seed = 1;
    std::function<void(double done)> progress;  // 0..1, from the calling thread; may be empty
    std::filesystem::path cache = {};           // cache folder for the next start of the same program; empty: no cache
};

class RenderedFrames final : public FrameSource {
  public:
    // scenes[k] is what ScheduleOptions::kinds[k] looks like; all have the same camera. The empty field is rendered,
    // too. Fails with invalid_argument (no scene, different cameras, no exposure) or as render() does.
    static Result<std::unique_ptr<RenderedFrames>> make(std::vector<Scene> scenes,
                                                        const RenderedFramesOptions& options = {});

    // By kind; the last is the empty field.
    [[nodiscard]] const std::vector<Scene>& scenes() const { return scenes_; }

    [[nodiscard]] Format format() const override;
    FrameView expose(const Exposure& exposure, std::span<std::byte> scratch) override;

  private:
    RenderedFrames() = default;
    [[nodiscard]] bool load_cache(const std::filesystem::path& file, int exposures);
    void save_cache(const std::filesystem::path& file) const;
    [[nodiscard]] LightField shifted(const LightField& field, int lenslets) const;

    std::vector<Scene> scenes_;
    std::vector<LightField> fields_;
    std::vector<std::vector<Frame>> ahead_;
    double nominal_share_ = 0;
};

}  // namespace hord::sim
