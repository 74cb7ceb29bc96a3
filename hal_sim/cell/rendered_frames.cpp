#include "hal_sim/cell/rendered_frames.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string>

#include "common/hash.h"
#include "hal_sim/world/random.h"

namespace hord::sim {
namespace {

bool same_camera(const Camera& a, const Camera& b) {
    return a.extents == b.extents && a.bits == b.bits && a.field_mm == b.field_mm && a.bin_pitch_rad == b.bin_pitch_rad;
}

// FNV-1a over 8 bytes at a time (the last ones padded with zeros), to detect a truncated or damaged file.
struct Sum {
    common::Fnv1a64 hash;
    void add(const void* bytes, std::size_t size) {
        for (std::size_t at = 0; at < size; at += 8) {
            std::uint64_t word = 0;
            std::memcpy(&word, static_cast<const char*>(bytes) + at, std::min<std::size_t>(8, size - at));
            hash.add_word(word);
        }
    }
};

// The name depends on the program (size and date of its file) and on the scenes, since both change the frames. Scenes
// count by name and pose: the seed decides the places of parts and defects.
std::filesystem::path cache_file(const std::filesystem::path& folder, const std::vector<Scene>& scenes,
                                 const RenderedFramesOptions& options) {
    std::error_code error;
    const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
    const auto size = std::filesystem::file_size(program, error);
    const auto date = std::filesystem::last_write_time(program, error).time_since_epoch().count();
    Sum sum;
    const auto add = [&](const auto& value) { sum.add(&value, sizeof value); };
    add(size);
    add(date);
    add(options.exposures);
    add(options.seed);
    for (const Scene& scene : scenes) {
        const algo::Extents& e = scene.camera.extents;
        for (const int n : {e.m, e.n, e.i, e.j, scene.camera.bits}) add(n);
        for (const double x : {scene.pose.x_mm, scene.pose.y_mm, scene.camera.field_mm, scene.camera.bin_pitch_rad})
            add(x);
        sum.add(scene.name.data(), scene.name.size());
    }
    return error ? std::filesystem::path() : folder / ("rendered-" + std::to_string(sum.hash.value()) + ".cache");
}

}  // namespace

Result<std::unique_ptr<RenderedFrames>> RenderedFrames::make(std::vector<Scene> scenes,
                                                             const RenderedFramesOptions& options) {
    if (scenes.empty() || options.exposures < 1) {
        return fail(ErrorCode::invalid_argument, "rendered frames need a scene a kind of part and an exposure of each",
                    "name scenes");
    }
    for (const Scene& scene : scenes) {
        if (!same_camera(scene.camera, scenes.front().camera)) {
            return fail(ErrorCode::invalid_argument,
                        "scene " + scene.name + " has another camera than " + scenes.front().name,
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
    const std::filesystem::path cached =
        options.cache.empty() ? "" : cache_file(options.cache, frames->scenes_, options);
    if (!cached.empty() && frames->load_cache(cached, options.exposures)) return frames;
    const auto count = static_cast<double>(frames->scenes_.size());
    for (std::size_t kind = 0; kind < frames->scenes_.size(); ++kind) {
        const Scene& scene = frames->scenes_[kind];
        RenderOptions render_options;
        if (options.progress) {
            render_options.progress = [&](double done) {
                options.progress((static_cast<double>(kind) + done) / count);
            };
        }
        auto field = render(scene, render_options);
        if (!field) return tl::unexpected(field.error());
        auto& ahead = frames->ahead_.emplace_back();
        for (int k = 0; k < options.exposures; ++k) {
            ahead.push_back(
                sim::expose(*field, scene, random_bits(options.seed, 0xE4F0 + kind, static_cast<std::uint64_t>(k))));
        }
        frames->fields_.push_back(std::move(*field));
    }
    if (!cached.empty()) frames->save_cache(cached);
    return frames;
}

// -- the cache: light fields and exposures, one after the other, then a sum of them all

bool RenderedFrames::load_cache(const std::filesystem::path& file, int exposures) {
    std::ifstream in(file, std::ios::binary);
    Sum sum;
    const auto read = [&](void* to, std::size_t size) {
        in.read(static_cast<char*>(to), static_cast<std::streamsize>(size));
        sum.add(to, size);
    };
    for (const Scene& scene : scenes_) {
        const Camera& camera = scene.camera;
        LightField field{camera.extents,
                         std::vector<float>(camera.extents.lenslets() *
                                            static_cast<std::size_t>(camera.extents.i * camera.extents.j))};
        read(field.bins.data(), field.bins.size() * sizeof(float));
        fields_.push_back(std::move(field));
        auto& ahead = ahead_.emplace_back();
        for (int k = 0; k < exposures; ++k) {
            Frame frame(camera.extents.width_px(), camera.extents.height_px(), camera.bits);
            read(frame.bytes().data(), frame.bytes().size());
            ahead.push_back(std::move(frame));
        }
    }
    std::uint64_t written = 0;
    in.read(reinterpret_cast<char*>(&written), sizeof written);
    if (in.good() && written == sum.hash.value() && in.peek() == std::ifstream::traits_type::eof()) return true;
    fields_.clear();
    ahead_.clear();
    return false;
}

// Failing to write the cache is no error: the next start renders again.
void RenderedFrames::save_cache(const std::filesystem::path& file) const {
    const std::filesystem::path beside = file.string() + ".new";
    {
        std::ofstream out(beside, std::ios::binary | std::ios::trunc);
        Sum sum;
        const auto write = [&](const void* from, std::size_t size) {
            out.write(static_cast<const char*>(from), static_cast<std::streamsize>(size));
            sum.add(from, size);
        };
        for (std::size_t kind = 0; kind < fields_.size(); ++kind) {
            write(fields_[kind].bins.data(), fields_[kind].bins.size() * sizeof(float));
            for (const Frame& frame : ahead_[kind]) write(frame.bytes().data(), frame.bytes().size());
        }
        const std::uint64_t checksum = sum.hash.value();
        out.write(reinterpret_cast<const char*>(&checksum), sizeof checksum);
        if (!out.flush()) return;
    }
    std::error_code ignored;
    for (const auto& entry :
         std::filesystem::directory_iterator(file.parent_path(), ignored)) {  // of other programs and scenes
        if (entry.path().extension() == file.extension()) std::filesystem::remove(entry.path(), ignored);
    }
    std::filesystem::rename(beside, file, ignored);
}

FrameSource::Format RenderedFrames::format() const {
    const Camera& camera = scenes_.front().camera;
    return {camera.extents.width_px(), camera.extents.height_px(), camera.bits};
}

// Shifts the part along m by whole lenslets; the empty field comes into view.
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

FrameView RenderedFrames::expose(const Exposure& exposure, std::span<std::byte> scratch) {
    const std::size_t kind = std::min(exposure.kind, fields_.size() - 1);
    const Scene& scene = scenes_[kind];
    const double pitch_mm = scene.camera.field_mm / scene.camera.extents.m;
    const int lenslets = static_cast<int>(std::lround(exposure.offset_mm / pitch_mm));
    if (std::abs(exposure.light - 1) <= nominal_share_ && lenslets == 0) {
        const auto& ahead = ahead_[kind];
        return ahead[exposure.seed % ahead.size()].view();
    }
    const Frame frame = lenslets == 0
        ? sim::expose(fields_[kind], scene, exposure.seed, exposure.light)
        : sim::expose(shifted(fields_[kind], lenslets), scene, exposure.seed, exposure.light);
    std::memcpy(scratch.data(), frame.bytes().data(), std::min(scratch.size(), frame.bytes().size()));
    FrameView view = frame.view();
    view.data = scratch.data();
    return view;
}

}  // namespace hord::sim
