// The simulated line's parts, each as an ordinary camera, the transmission and the features of HORDs show it, with the
// default recipe's verdict.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "algo/verdict/verdict.h"
#include "common/result.h"
#include "hal_sim/cell/production.h"

namespace hord::lab {

enum class LineView : std::uint8_t { telecentric, transmission, emd, frobenius };
constexpr std::array<std::string_view, 4> kLineViewNames{"telecentric camera", "transmission", "EMD gradient",
                                                         "Jacobian norm"};

struct SeenPart {
    sim::PartClass made_as = sim::PartClass::good;
    algo::Verdict verdict = algo::Verdict::unfit;
    algo::Reason reason = algo::Reason::none;
    float score = 0;
    // By LineView: the defect's peak over the good part's 99th percentile, at least 1 % for light (contrast_of in
    // lab/experiment/inspected_maps.h). Seen: from kVisible. 0 for a good part.
    std::array<double, kLineViewNames.size()> contrast{};
    double missing_light = 0;  // largest share that the transmission misses, or has too much, at the defect
};

// One good part and one part of each of `kinds`, drawn and exposed as the simulated line does with this seed. The good
// part is the first. `threads`: 0: one a core; results do not depend on it. Fails as rendering and inspecting do.
Result<std::vector<SeenPart>> see_parts(const std::vector<sim::PartClass>& kinds, std::uint64_t seed, int threads);

// The same for one defective scene and its good part: for tests.
Result<std::vector<SeenPart>> see_scenes(const std::vector<sim::Scene>& scenes,
                                         const std::vector<sim::PartClass>& kinds, std::uint64_t seed, int threads);

}  // namespace hord::lab
