// The features that can be computed for every lenslet, with their names and units.
//
// A distance compares two HORDs: of neighbours (a gradient), or of a lenslet and the reference HORD of the same place
// (prefix `reference-` before the name). The others are features of the surroundings of one lenslet.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace hord::algo {

enum class Feature : std::uint8_t {
    emd,                 // exact, Euclidean ground; bin pitches
    emd_l1,              // exact, Manhattan ground; bin pitches
    emd_sq,              // exact, squared Euclidean ground; bin pitches squared
    centroid,            // distance of the mean deflections; bin pitches
    marginal,            // sqrt(W1x^2 + W1y^2) of the marginals: a lower bound of emd; bin pitches
    sliced,              // mean W1 over projections: a lower bound of emd; bin pitches
    bhattacharyya,       // -ln of the overlap; saturates
    hellinger,           // 0..1
    chi2,                // 0..1
    cramer_von_mises,    // of localised cumulative distributions; bin pitches
    max_sliced,          // largest W1 over projections: a lower bound of emd; bin pitches
    jacobian_frobenius,  // of the mean deflection; bin pitches a lenslet
    jacobian_spectral,
    jacobian_nuclear,
    anisotropy,    // 0..1
    transmission,  // 1 is the part's typical lenslet
};

inline constexpr std::array<std::string_view, 16> kFeatureNames = {"emd",
                                                                   "emd-l1",
                                                                   "emd-sq",
                                                                   "centroid",
                                                                   "marginal",
                                                                   "sliced",
                                                                   "bhattacharyya",
                                                                   "hellinger",
                                                                   "chi2",
                                                                   "cramer-von-mises",
                                                                   "max-sliced",
                                                                   "jacobian-frobenius",
                                                                   "jacobian-spectral",
                                                                   "jacobian-nuclear",
                                                                   "anisotropy",
                                                                   "transmission"};

inline constexpr Feature kLastDistance = Feature::max_sliced;

struct FeatureChoice {
    Feature feature = Feature::emd;
    bool against_reference = false;
    friend bool operator==(const FeatureChoice&, const FeatureChoice&) = default;
};

constexpr bool is_distance(Feature feature) { return feature <= kLastDistance; }

constexpr std::string_view name_of(Feature feature) { return kFeatureNames[static_cast<std::size_t>(feature)]; }

inline std::string name_of(FeatureChoice choice) {
    return (choice.against_reference ? "reference-" : "") + std::string(name_of(choice.feature));
}

// The feature of that name; nullopt if there is none, or if it has no reference form.
constexpr std::optional<FeatureChoice> feature_named(std::string_view name) {
    constexpr std::string_view kReference = "reference-";
    const bool against_reference = name.substr(0, kReference.size()) == kReference;
    if (against_reference) name.remove_prefix(kReference.size());
    for (std::size_t k = 0; k < kFeatureNames.size(); ++k) {
        const auto feature = static_cast<Feature>(k);
        if (kFeatureNames[k] == name && (is_distance(feature) || !against_reference))
            return FeatureChoice{feature, against_reference};
    }
    return std::nullopt;
}

// The unit of its values as text; empty for pure numbers.
constexpr std::string_view unit_of(Feature feature) {
    switch (feature) {
        case Feature::emd:
        case Feature::emd_l1:
        case Feature::centroid:
        case Feature::marginal:
        case Feature::sliced:
        case Feature::cramer_von_mises:
        case Feature::max_sliced: return "bin pitches";
        case Feature::emd_sq: return "bin pitches squared";
        case Feature::jacobian_frobenius:
        case Feature::jacobian_spectral:
        case Feature::jacobian_nuclear: return "bin pitches a lenslet";
        default: return "";
    }
}

}  // namespace hord::algo
