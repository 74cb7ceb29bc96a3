#include "hal_sim/cell/rendered_frames.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "hal_sim/cell/random.h"

namespace hord::sim {
namespace {

bool same_camera(const Camera& a, const Camera& b) {
    return a.extents == b.extents && a.bits == b.bits && a.field_mm == b.field_mm && a.bin_pitch_rad == b.bin_pitch_rad;
}

}  // namespace

Result<std::unique_ptr<RenderedFrames>> RenderedFrames::make(std::vector<Scene> scenes, const RenderedFramesOptions& options) {
    if (scenes.empty() || options.exposures < 1) {
        return fail(ErrorCode::invalid_argument, "rendered frames need a scene a kind of part and an exposure of each", "name scenes");
    }
    for (const Scene& scene : scenes) {
        if (!same_camera(scene.camera, scenes.front().camera)) {
            return fail(ErrorCode::invalid_argument, "scene " + scene.name + " has another camera than " + scenes.front().name,
                        "give all scenes of a cell the same [camera]");
        }
    }
    Scene empty = scenes.front();
    empty.name = "empty field";
    empty.part = NoPart{};
    empty.defects.clear();
    scenes.push_back(empty);

    std::unique_ptr<RenderedFrames> frames(new RenderedFrames());
    frames->nominal_share_ = options.nominal_share;
    frames->scenes_ = std::move(scenes);
    const auto count = static_cast<double>(frames->scenes_.size());
    for (std::size_t kind = 0; kind < frames->scenes_.size(); ++kind) {
        const Scene& scene = frames->scenes_[kind];
        RenderOptions render_options;
        if (options.progress) {
            render_options.progress = [&](double done) { options.progress((static_cast<double>(kind) + done) / count); };
        }
        auto field = render(scene, render_options);
        if (!field) return tl::unexpected(field.error());
        auto& ahead = frames->ahead_.emplace_back();
        for (int k = 0; k < options.exposures; ++k) {
            ahead.push_back(sim::expose(*field, scene, random_bits(options.seed, 0xE4F0 + kind, static_cast<std::uint64_t>(k))));
        }
        frames->fields_.push_back(std::move(*field));
    }
    return frames;
}

FrameSource::Format RenderedFrames::format() const {
    const Camera& camera = scenes_.front().camera;
    return {camera.extents.width_px(), camera.extents.height_px(), camera.bits};
}

// The part moves along m, whole lenslets; what comes into view is the empty field.
LightField RenderedFrames::shifted(const LightField& field, int lenslets) const {
    LightField out = fields_.back();
    const algo::Extents& e = field.extents;
    const int moved = std::min(std::abs(lenslets), e.m) * e.i;
    const int width = e.width_px(), from = lenslets < 0 ? moved : 0, to = lenslets > 0 ? moved : 0;
    for (int y = 0; y < e.height_px(); ++y) {
        const auto row = static_cast<std::ptrdiff_t>(y) * width;
        std::copy_n(field.bins.begin() + row + from, width - moved, out.bins.begin() + row + to);
    }
    return out;
}

algo::FrameView RenderedFrames::expose(const Exposure& exposure, std::span<std::byte> scratch) {
    const std::size_t kind = std::min(exposure.kind, fields_.size() - 1);
    const Scene& scene = scenes_[kind];
    const double pitch_mm = scene.camera.field_mm / scene.camera.extents.m;
    const int lenslets = static_cast<int>(std::lround(exposure.offset_mm / pitch_mm));
    if (std::abs(exposure.light - 1) <= nominal_share_ && lenslets == 0) {
        const auto& ahead = ahead_[kind];
        return ahead[exposure.seed % ahead.size()].view();
    }
    const algo::Frame frame = lenslets == 0 ? sim::expose(fields_[kind], scene, exposure.seed, exposure.light)
                                            : sim::expose(shifted(fields_[kind], lenslets), scene, exposure.seed, exposure.light);
    std::memcpy(scratch.data(), frame.bytes().data(), std::min(scratch.size(), frame.bytes().size()));
    algo::FrameView view = frame.view();
    view.data = scratch.data();
    return view;
}

}  // namespace hord::sim
