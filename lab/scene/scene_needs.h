// Which effects a scene requires: each is left out, and the change of the features is compared with a tolerance.
//
// The change is the 99th percentile of its absolute value over the lenslets off the rims (labels 0, 1 and 3 of the
// scene's truth), the largest of three features:
//   EMD gradient, bin pitches over two lenslets; Jacobian's Frobenius norm, bin pitches a lenslet; light of the
//   lenslet, as a share of the median lenslet's.
// Effects of the light are compared without noise at 16 bits; effects of the sensor on exposures of the full light
// field with the scene's bits and seed, the same draws with and without.
//
// The required set is found greedily: effects are removed, the one with the least change first, as long as the change
// by all removed effects together stays within the tolerance. A smaller set of other effects may exist.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/result.h"
#include "hal_sim/optics/scene/scene.h"
#include "lab/optics/effects.h"

namespace hord::lab {

struct FeatureChange {
    double emd = 0, jacobian = 0, transmission = 0;  // 99th percentiles
    double emd_rms = 0, jacobian_rms = 0, transmission_rms = 0;
    int unseen = 0;  // lenslets that have a gradient only with the effect or only without it
    [[nodiscard]] double largest() const;
};

struct EffectNeed {
    Effect effect;
    FeatureChange change;  // without it
    double cost_ms = 0;    // processor time of the frame with it less that without it
    bool required = false;
};

struct SceneNeeds {
    double tolerance = 0;
    double render_ms = 0, expose_ms = 0;  // of the whole scene
    std::vector<EffectNeed> effects;      // in the order of Effect
    FeatureChange left_out;  // by all effects that are not required together; the larger of light and sensor
    int lenslets = 0;        // compared
    [[nodiscard]] std::vector<Effect> required() const;
};

struct NeedsOptions {
    double tolerance = 0.05;
    int threads = 0;
    std::function<void(double done)> progress;
};

// Fails as sim::render() does.
Result<SceneNeeds> needs_of(const sim::Scene& scene, const NeedsOptions& options);

std::string table_of(const SceneNeeds& needs);

}  // namespace hord::lab
