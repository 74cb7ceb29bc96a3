// What the figure's scenes show, and the paper's claims about it.
#pragma once

#include <array>
#include <vector>

#include "lab/experiment/experiment.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/paper/paper_views.h"

namespace hord::lab {

constexpr double kAbsorberTransmission = 0.5;
constexpr double kAreaLightMm = 30;  // half width of the telecentric camera's light, at which it sees the cut
constexpr double kInclusionIndex = 1.52;
// `both`: the cut, and an inclusion of kInclusionIndex in the bubble's place. `plenoptic`: the clean lens before a
// conventional plenoptic camera.
enum SceneNumber : std::size_t { kClean, kCut, kBubble, kAbsorber, kBoth, kPlenoptic, kScenes };
constexpr std::array<View, kViews> kAllViews = {View::emd,         View::frobenius, View::transmission,
                                                View::telecentric, View::emd_even,  View::frobenius_even};

struct Figure {
    std::vector<SceneViews> scenes;
    std::array<Interior, kViews> interior;
    // Of the scene's defects in their order. kClean and kPlenoptic: none.
    std::array<std::array<std::vector<Contrast>, kViews>, kScenes> contrast;

    [[nodiscard]] const Contrast& of(SceneNumber scene, View view, std::size_t defect = 0) const {
        return contrast[scene][static_cast<std::size_t>(view)].at(defect);
    }
    [[nodiscard]] const Interior& clean(View view) const { return interior[static_cast<std::size_t>(view)]; }
    [[nodiscard]] double true_radius(SceneNumber scene) const {
        return scenes[scene].truth.defects.at(0).radius_lenslets;
    }
};

// Information about whether a lenslet lies in the defect, bits a lenslet, that the view's value gives (mutual
// information): lenslets within twice the defect's radius and eight lenslets, values in steps of a quarter octave of
// the clean interior's 99th percentile, "no value" a step of its own.
double information_of(const Figure& figure, SceneNumber scene, View view);

std::vector<Claim> claims_of_figure(const Figure& figure, bool quick);

}  // namespace hord::lab
