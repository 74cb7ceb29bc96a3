// One scene of the paper's figure, seen by every instrument; and its pictures.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "firmware/diagnostics/map_images.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

// The instruments, in the order of the figure. The `even` forms give a dark lenslet an evenly filled HORD; the paper
// leaves it open.
enum class View : std::uint8_t { emd, frobenius, transmission, telecentric, emd_even, frobenius_even };
constexpr std::size_t kViews = 6, kViewsOfFigure = 4;
std::string_view name_of(View view);
std::string_view file_name_of(View view);

struct SceneViews {
    sim::Scene scene;
    sim::Truth truth;
    std::string frame_hash;
    InspectedMaps sight, even;
    std::vector<float> telecentric;  // one value a lenslet: as many pixels, over the same field
    std::vector<std::uint8_t>
        everywhere_valid;  // the telecentric picture's mask, and the transmission's: kValid inside the rim

    [[nodiscard]] std::span<const float> map(View view) const;          // what is drawn
    [[nodiscard]] std::span<const std::uint8_t> mask(View view) const;  // with its rim and outside
    [[nodiscard]] std::vector<float> signal(
        View view) const;  // what is told apart: the map, or how far the light is from usual
};

// Signals below this are nothing, whatever the clean part shows: one percent of the light, the photon noise of 10,000
// electrons.
double floor_of(View view);

// Renders and looks. A frame kept in `folder` by an earlier run is taken up if it has the bits that run noted in
// `cells`.
Result<SceneViews> see(const sim::Scene& scene, const std::filesystem::path& folder, int threads, ResultCache& cells,
                       const std::function<void(double)>& progress);

// The map in the figure's colours: the same scale for a view of all scenes. `around` > 0: only so many lenslets about
// (m, n).
firmware::Picture picture_of(const SceneViews& views, View view, const std::string& title, float high);
firmware::Picture close_picture_of(const SceneViews& views, View view, const std::string& title, float high, double m,
                                   double n, int lenslets);

}  // namespace hord::lab
