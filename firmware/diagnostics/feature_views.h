// The maps of an inspection as they are shown and written: which lenslets have a value, which are judged, which map
// decided.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"

namespace hord::firmware {

inline constexpr std::string_view kZScore = "z-score";  // the worst score against a reference
inline constexpr std::string_view kSums = "sums";       // the light of each lenslet: shown of frames that are unfit

// A map with what is needed to read it. A lenslet has no value if its mask has a bit of `no_value`; it is not judged if
// it has no value or a bit of `not_judged`.
struct FeatureView {
    std::string name{};   // as in --feature and in names of files
    std::string title{};  // for people
    std::string unit{};   // for people
    algo::Map map{};      // one value a lenslet, row by row
    // MaskBit, one a lenslet. A bit is set only where it matters for this feature: the transmission of a dark lenslet
    // is a value that is judged, so kDark is not set there.
    std::span<const std::uint8_t> mask{};
    std::uint8_t no_value = algo::kNoGradient;
    std::uint8_t not_judged = algo::kNotJudged;
    float limit = 0;           // of the value that rejects; 0: nothing is judged by it
    std::string limit_text{};  // "limit 0.4"; "limit 1 + good": above that of a good part at the same place
    bool is_light = false;     // drawn as a camera's picture, in grey, nothing dimmed: the sums

    [[nodiscard]] bool has_value(std::size_t k) const { return (mask[k] & no_value) == 0; }
    [[nodiscard]] bool is_judged(std::size_t k) const { return (mask[k] & (no_value | not_judged)) == 0; }
};

// "bin pitches", "of the typical lenslet", "0 to 1", ... A distance over neighbours is the root of two squares, one a
// direction, so what is at most 1 against a reference is at most 1.41 there.
std::string unit_for_people(algo::Feature feature, bool against_reference = false);

// NaN where there is no value.
std::vector<float> with_no_data(algo::Map map, std::span<const std::uint8_t> mask, std::uint8_t no_value);

class FeatureViews {
  public:
    // `found` and `recipe` outlive this. The gradient's map has a value everywhere only with MapSet::all.
    FeatureViews(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents);
    FeatureViews(const FeatureViews&) = delete;
    FeatureViews& operator=(const FeatureViews&) = delete;

    // The features that the recipe judges by: z-score, gradient, slope, transmission, as far as it chooses them.
    [[nodiscard]] std::span<const FeatureView> judged() const { return judged_; }

    // The map that decided. Of a reject: the feature whose limit the worst defect exceeds most. Of a pass: the feature
    // that comes closest to its limit. Of an unfit frame: the sums.
    [[nodiscard]] const FeatureView& deciding() const;

    // A judged one, the sums, or another map of MapSet::all by its feature's name; null: there is none.
    [[nodiscard]] const FeatureView* find(std::string_view name) const;

  private:
    void add_z_score();
    void add_gradient();
    void add_maps_of_jacobian();
    void add_transmission();
    void add_sums();
    [[nodiscard]] std::string limit_text(float limit) const;
    [[nodiscard]] float severity(const FeatureView& view, std::size_t k) const;
    [[nodiscard]] bool in_worst_defect(std::size_t k) const;

    const algo::Inspection& found_;
    const algo::Recipe& recipe_;
    const algo::Extents extents_;
    std::vector<FeatureView> judged_, others_;  // others_: the sums first
    std::vector<std::uint8_t> mask_of_light_, mask_of_sums_, mask_of_score_;
    std::vector<float> sums_, no_scores_;
};

}  // namespace hord::firmware
