// Which of a scene's effects matter: each is left out, and what that changes in the features is compared with a
// tolerance.
//
// The change is that of a lenslet off the rims (labels 0, 1 and 3 of the scene's truth): the 99th percentile over
// lenslets of its absolute value, the largest of three features counts:
//   EMD gradient, bin pitches over two lenslets; Jacobian's Frobenius norm, bin pitches a lenslet; light of the
//   lenslet, as a share of the median lenslet's.
// Effects of the light are compared without noise at 16 bits; effects of the sensor on exposures of the full light
// field with the scene's bits and seed, the same draws with and without.
//
// The set that a scene requires is found by leaving effects out for good, the least one first, as long as all that is
// left out together stays within the tolerance. What remains cannot lose another one; a smaller set of other effects is
// not looked for.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/result.h"
#include "hal_sim/optics/scene/effects.h"

namespace hord::lab {

struct FeatureChange {
    double emd = 0, jacobian = 0, transmission = 0;  // 99th percentiles
    double emd_rms = 0, jacobian_rms = 0, transmission_rms = 0;
    int unseen = 0;  // lenslets that have a value with the effect or without it, not both
    [[nodiscard]] double largest() const;
};

struct EffectNeed {
    sim::Effect effect;
    FeatureChange change;  // without it
    double cost_ms = 0;    // processor time that it takes: of the frame with it, less of the frame without
    bool required = false;
};

struct SceneNeeds {
    double tolerance = 0;
    double render_ms = 0, expose_ms = 0;  // of the whole scene
    std::vector<EffectNeed> effects;      // in the order of sim::Effect
    FeatureChange left_out;               // by all that are not required together; the larger of light and sensor
    int lenslets = 0;                     // compared
    [[nodiscard]] std::vector<sim::Effect> required() const;
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
