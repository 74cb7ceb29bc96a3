// Which effects a scene requires: each is left out, and what that changes is compared with a tolerance. Effects that
// the scene does not name are tried at typical values (lab/optics/effects.h).
//
// An effect is required if it changes the verdict of the recipe, the number of false defects (away from true ones), the
// contrast of a true defect by more than kContrastChange, or the field by more than the tolerance. The first three see
// what is too small for a percentile: a grain of dust, one more dark lenslet. The contrast is the largest value of a
// feature at true defects over the 99th percentile of the other judged lenslets, for each of the three features below;
// of the light, of its difference from the median. It counts from 2 to 10: below, the defect is not seen; above, it is
// clear.
//
// The change of the field is the 99th percentile of its absolute value over the lenslets off the rims (labels 0, 1 and
// 3 of the scene's truth), the largest of three features:
//   EMD gradient, bin pitches over two lenslets; Jacobian's Frobenius norm, bin pitches a lenslet; light of the
//   lenslet, as a share of the median lenslet's.
// Effects of the light are compared without noise at 16 bits; effects of the sensor on exposures of the full light
// field with the scene's bits and seed, the same draws with and without.
//
// The required set is found greedily: effects are removed, the one with the least change first, as long as the change
// by all removed effects together stays within the tolerance. A smaller set of other effects may exist.
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "algo/recipe/recipe.h"
#include "common/result.h"
#include "hal_sim/optics/scene/scene.h"
#include "lab/optics/effects.h"

namespace hord::lab {

constexpr std::size_t kContrasts = 3;  // EMD gradient, Jacobian, light
using Contrasts = std::array<double, kContrasts>;

struct FeatureChange {
    double emd = 0, jacobian = 0, transmission = 0;  // 99th percentiles
    double emd_rms = 0, jacobian_rms = 0, transmission_rms = 0;
    int unseen = 0;  // lenslets that have a gradient only with the effect or only without it
    algo::Verdict verdict{}, verdict_without{};
    Contrasts contrast{}, contrast_without{};  // of the true defects; 0: none
    int false_defects = 0, false_defects_without = 0;
    [[nodiscard]] double largest() const;                             // of the field
    [[nodiscard]] double contrast_change(std::size_t feature) const;  // relative, where it counts
    // The feature whose contrast changes most, if that matters, else the one that sees the defects best; kContrasts: no
    // feature sees them.
    [[nodiscard]] std::size_t shown() const;
    // Why this is more than nothing, "verdict", "false defects", "contrast", "field"; empty: it is not.
    [[nodiscard]] std::string_view matters(double tolerance) const;
};
constexpr double kContrastChange = 0.25;  // relative

struct EffectNeed {
    Effect effect;
    FeatureChange change;  // without it
    double cost_ms = 0;    // processor time of the frame with it less that without it
    bool required = false;
    bool named = true;  // by the scene; else tried at its typical value, and required means: name it
};

struct SceneNeeds {
    double tolerance = 0;
    double render_ms = 0, expose_ms = 0;  // of the whole scene
    std::vector<EffectNeed> effects;      // in the order of Effect
    FeatureChange left_out;   // by all effects that are not required together; the larger of light and sensor
    int lenslets = 0;         // compared
    algo::Verdict verdict{};  // of the exposed frame
    algo::Reason reason{};
    [[nodiscard]] std::vector<Effect> required() const;  // of those that the scene names
    [[nodiscard]] std::vector<Effect> spare() const;     // of those that the scene names, not required
    [[nodiscard]] std::vector<Effect> missing() const;   // not named, and would matter
};

struct NeedsOptions {
    double tolerance = 0.05;
    int threads = 0;
    algo::Recipe recipe = {};
    bool typical = true;  // try effects that the scene does not name
    std::function<void(double done)> progress;
};

// Fails as sim::render() does.
Result<SceneNeeds> needs_of(const sim::Scene& scene, const NeedsOptions& options);

std::string table_of(const SceneNeeds& needs);

}  // namespace hord::lab
