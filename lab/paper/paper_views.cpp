#include "lab/paper/paper_views.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "drivers/files/frame_file.h"
#include "hal_sim/optics/camera/telecentric.h"

namespace hord::lab {

using namespace firmware;
namespace {

// The scene's frame: read from the folder if its hash is in the cells, else rendered.
Result<Frame> frame_of(const sim::Scene& scene, const std::filesystem::path& folder, int threads, ResultCache& cells,
                       const std::function<void(double)>& progress, std::string& hash) {
    const auto file = folder / ("frame_" + scene.name + ".png");
    const std::string key = "frame " + scene.name;
    if (const Json* kept = cells.find(key)) {
        const auto frame = drivers::read_frame(file);
        if (frame && hash_of(frame->bytes()) == kept->get<std::string>()) {
            hash = kept->get<std::string>();
            return *frame;
        }
    }
    const auto light = sim::render(scene, {threads, progress});
    if (!light) return tl::unexpected(light.error());
    Frame frame = sim::expose(*light, scene, scene.seed);
    const drivers::FrameGeometry geometry{drivers::FrameKind::macro_pixels, scene.camera.extents, frame.bits()};
    if (auto done = drivers::write_frame(file, frame.view(), geometry); !done) return tl::unexpected(done.error());
    hash = hash_of(frame.bytes());
    if (auto done = cells.add(key, hash); !done) return tl::unexpected(done.error());
    return frame;
}

}  // namespace

std::string_view name_of(View view) {
    constexpr std::string_view names[kViews] = {"EMD gradient",
                                                "Frobenius norm",
                                                "transmission",
                                                "telecentric camera",
                                                "EMD gradient, dark lenslets taken as even",
                                                "Frobenius norm, dark lenslets taken as even"};
    return names[static_cast<std::size_t>(view)];
}
std::string_view file_name_of(View view) {
    constexpr std::string_view names[kViews] = {"emd",         "frobenius", "transmission",
                                                "telecentric", "emd-even",  "frobenius-even"};
    return names[static_cast<std::size_t>(view)];
}

double floor_of(View view) { return view == View::transmission || view == View::telecentric ? 0.01 : 0.0; }

std::span<const float> SceneViews::map(View view) const {
    switch (view) {
        case View::emd: return maps.emd;
        case View::frobenius: return maps.frobenius;
        case View::transmission: return maps.transmission;
        case View::telecentric: return telecentric;
        case View::emd_even: return maps_even.emd;
        case View::frobenius_even: return maps_even.frobenius;
    }
    return {};
}

std::span<const std::uint8_t> SceneViews::mask(View view) const {
    if (view == View::emd || view == View::frobenius) return maps.mask;
    if (view == View::emd_even || view == View::frobenius_even) return maps_even.mask;
    return everywhere_valid;
}

std::vector<float> SceneViews::signal(View view) const {
    const auto values = map(view);
    std::vector<float> out(values.begin(), values.end());
    if (view == View::transmission || view == View::telecentric) {
        for (float& v : out) v = std::abs(1.0F - v);
    }
    return out;
}

Result<SceneViews> inspect_scene(const sim::Scene& scene, const std::filesystem::path& folder, int threads,
                                 ResultCache& cells, const std::function<void(double)>& progress) {
    SceneViews views;
    views.scene = scene;
    views.truth = truth_of(scene);
    const algo::Extents& e = scene.camera.extents;
    const auto frame = frame_of(scene, folder, threads, cells, progress, views.frame_hash);
    if (!frame) return tl::unexpected(frame.error());
    auto maps = inspect_frame(*frame, e, 1);
    if (!maps) return tl::unexpected(maps.error());
    auto maps_even = inspect_frame(with_dark_as_uniform(*frame, *maps), e, 1);
    if (!maps_even) return tl::unexpected(maps_even.error());
    if (scene.defects.empty()) {
        algo::Recipe unchecked;
        unchecked.part_required = false;
        const auto seen = inspect_frame(*frame, e, 1, unchecked);
        if (!seen) return tl::unexpected(seen.error());
        views.unchecked_verdict = seen->verdict, views.unchecked_score = seen->score;
    }
    auto picture = render_telecentric(scene, {threads, {}});
    if (!picture) return tl::unexpected(picture.error());
    views.maps = std::move(*maps);
    views.maps_even = std::move(*maps_even);
    views.telecentric = std::move(picture->light);
    views.everywhere_valid = views.maps.mask;
    for (std::uint8_t& bits : views.everywhere_valid) bits &= algo::kNotJudged;
    return views;
}

namespace {

std::string unit_of(View view) {
    return floor_of(view) > 0 ? "of usual" : view == View::emd || view == View::emd_even ? "bins" : "bins/lenslet";
}

// The rim is drawn in colour, too.
std::vector<std::uint8_t> drawn_mask(const SceneViews& views, View view) {
    std::vector<std::uint8_t> mask(views.mask(view).begin(), views.mask(view).end());
    for (std::uint8_t& bits : mask) bits &= static_cast<std::uint8_t>(~algo::kNotJudged);
    return mask;
}

// The unit is in the column's title.
MapPicture of_figure(View view, float high) {
    const std::string_view name = view == View::emd_even ? "EMD, dark as even" : name_of(view);
    MapPicture what{fmt::format("{}, {}", name, unit_of(view)), "", 0, high};
    what.letters = kLettersOfFigure;
    what.axes = false;
    return what;
}

}  // namespace

Picture picture_of(const SceneViews& views, View view, const std::string& title, float high) {
    return draw({title, unit_of(view), 0, high}, views.map(view), drawn_mask(views, view), views.scene.camera.extents,
                {});
}

Picture picture_of_figure(const SceneViews& views, View view, float high) {
    return draw(of_figure(view, high), views.map(view), drawn_mask(views, view), views.scene.camera.extents, {});
}

Picture close_picture_of(const SceneViews& views, View view, float high, double m, double n, int lenslets) {
    const algo::Extents& e = views.scene.camera.extents;
    const int m0 = std::clamp(static_cast<int>(std::lround(m)) - lenslets / 2, 0, e.m - lenslets);
    const int n0 = std::clamp(static_cast<int>(std::lround(n)) - lenslets / 2, 0, e.n - lenslets);
    const std::vector<std::uint8_t> all = drawn_mask(views, view);
    std::vector<float> map;
    std::vector<std::uint8_t> mask;
    for (int y = 0; y < lenslets; ++y) {
        for (int x = 0; x < lenslets; ++x) {
            const auto k = static_cast<std::size_t>((n0 + y) * e.m + m0 + x);
            map.push_back(views.map(view)[k]);
            mask.push_back(all[k]);
        }
    }
    return draw(of_figure(view, high), map, mask, {lenslets, lenslets, e.i, e.j}, {});
}

}  // namespace hord::lab
