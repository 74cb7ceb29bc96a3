#include "algo/reference/reference.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "algo/reference/pooled_scores.h"

namespace hord::algo {

Result<void> check(const Reference& r) {
    if (auto fine = check(r.extents); !fine) return fine;
    if (auto fine = check_bits(r.bits); !fine) return fine;
    const auto refuse = [](const std::string& what) -> Result<void> {
        return fail(ErrorCode::invalid_argument, "the reference's " + what, "learn it again: hordctl learn");
    };
    if (r.parts < Reference::kMinParts) return refuse("parts are fewer than " + std::to_string(Reference::kMinParts));
    const auto count = r.extents.lenslets();
    if (r.shares.size() != count * r.stride() || r.mask.size() != count)
        return refuse("reference HORDs are not one a lenslet");
    const auto sound = [&](const std::vector<float>& map, double low, double high) {
        return map.size() == count && std::ranges::all_of(map, [&](float v) {
                   return v >= static_cast<float>(low) && v <= static_cast<float>(high);
               });
    };
    if (!sound(r.light, 0, kSumLimit)) return refuse("light is out of range");
    if (!sound(r.x, -8, 8) || !sound(r.y, -8, 8)) return refuse("deflections are out of range");
    for (const auto& map : r.spread) {
        if (!sound(map, 0, 1e9)) return refuse("spreads are out of range");
    }
    if (!sound(r.emd, 0, 100) || !sound(r.frobenius, 0, 100)) return refuse("gradients are out of range");
    const auto& scales = r.pooled_scales;
    if ((!scales.empty() && scales.size() != pooled_filters().size()) ||
        !std::ranges::all_of(scales, [](float v) { return v >= 0 && v < 1e6F; }))
        return refuse("scales of what lenslets show together are not those of this program");
    if (!std::ranges::all_of(r.size_limits, [](float v) { return v >= 0 && v < 1e4F; }))
        return refuse("limits of the size are out of range");
    if (!std::ranges::all_of(r.blur_limits, [](float v) { return v >= 0 && v < 1e4F; }))
        return refuse("limits of the edges' blur are out of range");
    if (!(r.patch_limit >= 0 && r.patch_limit < 1e6F)) return refuse("limit of squares of lenslets is out of range");
    if (std::ranges::any_of(r.shares, [](std::uint16_t v) { return v > Reference::kMaxShare; }))
        return refuse("shares are not below 1");
    if (!(r.sensor.electrons_per_dn > 0 && r.sensor.electrons_per_dn < 1e6F && r.sensor.read_dn >= 0 &&
          r.sensor.read_dn < 1e4F && r.sensor.clip_dn >= 0 && r.sensor.clip_dn <= 65535)) {
        return refuse("sensor noise is out of range");
    }
    return {};
}

}  // namespace hord::algo
