// Words of a recipe's file, for those who read and write it.
#pragma once

#include <array>
#include <string_view>

#include "algo/features/feature.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference.h"

namespace hord::firmware {

inline constexpr int kRecipeSchema = 1;
inline constexpr unsigned kDefectKinds = 5;
inline constexpr std::array<std::string_view, 4> kPartForms{"round", "tube", "plate", "web"};  // as algo::PartForm
inline constexpr std::array<std::string_view, 2> kPartPresence{"required", "unchecked"};
inline constexpr std::array<std::string_view, 2> kOutlines{"symmetric", "any"};
inline constexpr std::array<std::string_view, 2> kChecked{"checked", "unchecked"};

// The features that a recipe can name: the gradients, then these two.
inline constexpr std::string_view kSlopes = name_of(algo::Feature::jacobian_frobenius),
                                  kLight = name_of(algo::Feature::transmission);

// The keys of [limits] for the gradients.
constexpr std::string_view limit_key(algo::Feature gradient) {
    switch (gradient) {
        case algo::Feature::emd: return "emd_bins";
        case algo::Feature::marginal: return "marginal_bins";
        default: return name_of(gradient);
    }
}

// The middle of the reference's field, where places in mm have their origin, in lenslets.
inline algo::Point middle_of(const algo::Reference& reference) {
    return {0.5F * static_cast<float>(reference.extents.m - 1), 0.5F * static_cast<float>(reference.extents.n - 1)};
}

}  // namespace hord::firmware
