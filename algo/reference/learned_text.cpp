// What is told of a reference beside the parts that were left out.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "algo/reference/pose_tolerance.h"
#include "algo/reference/reference_learner.h"

namespace hord::algo {
namespace {

// The rounding of a sample varies by 1/12 DN^2. Where photons at full scale vary less, no noise of theirs was seen.
bool shows_no_noise(const Reference& r) {
    constexpr float kMaxEstimate = 1e5F;  // electrons a DN: the end of the range that is estimated
    const auto full_dn = static_cast<float>((1 << r.bits) - 1);
    return r.sensor.electrons_per_dn >= std::min(12 * full_dn, kMaxEstimate);
}

std::string on_pose(const Learned& learned) {
    constexpr const char* kNames[] = {"the shift along x", "the shift along y", "the turn"};
    std::string unknown;
    for (std::size_t u = 0; u < 3; ++u) {
        if (!learned.pose_determined[u]) unknown += (unknown.empty() ? "" : ", ") + std::string(kNames[u]);
    }
    if (unknown.empty()) return {};
    return "Pose not determined: " + unknown +
        "; it changes these parts' light by no more than a tilt does, and what is told of it means little";
}

std::string on_tolerance(const Learned& learned, double reject_score) {
    std::vector<double> shifts;
    for (const auto& pose : learned.poses) {
        if (pose) shifts.push_back(std::hypot(pose->x, pose->y));
    }
    const auto tolerance = edge_tolerance(learned.reference, shifts, reject_score);
    if (!tolerance) return {};
    std::array<char, 260> text{};
    std::snprintf(text.data(), text.size(),
                  "Good parts whose edges lie more than %.2g lenslet from where these parts had them may be rejected "
                  "there (these lay within %.2g of their middle): learn from parts that lie as differently as those "
                  "to be judged",
                  *tolerance, std::ranges::max(shifts));
    return text.data();
}

}  // namespace

std::vector<std::string> unsure_of(const Learned& learned, const std::string& cure, double reject_score) {
    std::vector<std::string> sentences;
    if (learned.gain_unsure) {
        sentences.push_back(
            "No place of the field shows photon noise alone, so the electrons a DN count form and ripple "
            "as noise and may be several times too low: " +
            cure);
    }
    if (shows_no_noise(learned.reference)) {
        sentences.push_back(
            "These frames show no photon noise, so noise of the parts to be judged will count as a defect: learn from "
            "single exposures as the camera takes them, or " +
            cure);
    }
    for (std::string sentence : {on_pose(learned), on_tolerance(learned, reject_score)}) {
        if (!sentence.empty()) sentences.push_back(std::move(sentence));
    }
    return sentences;
}

}  // namespace hord::algo
