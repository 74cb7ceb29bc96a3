// One scene of the paper's figure in every view, and its pictures.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "firmware/diagnostics/map_images.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/result_cache.h"
#include "lab/optics/truth.h"

namespace hord::lab {

// The views, in the order of the figure. The `even` forms give a dark lenslet an evenly filled HORD, since the paper
// does not define its HORD.
enum class View : std::uint8_t { emd, frobenius, transmission, telecentric, emd_even, frobenius_even };
constexpr std::size_t kViews = 6, kViewsOfFigure = 4;
std::string_view name_of(View view);
std::string_view file_name_of(View view);

struct SceneViews {
    sim::Scene scene;
    Truth truth;
    std::string frame_hash;
    InspectedMaps maps, maps_even;
    // Of a scene without defects: by a recipe that does not ask for a whole part (part_required).
    algo::Verdict unchecked_verdict = algo::Verdict::unfit;
    double unchecked_score = 0;
    std::vector<float> telecentric;              // one value a lenslet: as many pixels, over the same field
    std::vector<std::uint8_t> everywhere_valid;  // mask of the telecentric picture and the transmission: only the rim

    [[nodiscard]] std::span<const float> map(View view) const;          // as drawn
    [[nodiscard]] std::span<const std::uint8_t> mask(View view) const;  // with its rim and outside
    // 0 for a good part: the map, or the deviation of the light from its usual value.
    [[nodiscard]] std::vector<float> signal(View view) const;
};

// Signals below this do not count: one percent of the light, the photon noise of 10,000 electrons.
double floor_of(View view);

// Renders and inspects the scene. Uses the frame that an earlier run left in `folder` if its hash is the one in
// `cells`.
Result<SceneViews> inspect_scene(const sim::Scene& scene, const std::filesystem::path& folder, int threads,
                                 ResultCache& cells, const std::function<void(double)>& progress);

// The map in the figure's colours up to `high`.
firmware::Picture picture_of(const SceneViews& views, View view, const std::string& title, float high);
// The same with large letters, for a figure of many pictures that is halved.
firmware::Picture picture_of_figure(const SceneViews& views, View view, float high);
// A close-up for such a figure: `lenslets` squared lenslets about (m, n).
firmware::Picture close_picture_of(const SceneViews& views, View view, float high, double m, double n, int lenslets);
constexpr float kLettersOfFigure = 2.5F;

}  // namespace hord::lab
