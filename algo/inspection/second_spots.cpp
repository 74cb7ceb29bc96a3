// FrameChecks: a ghost that a part of the field shows.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "algo/frame/mask.h"
#include "algo/inspection/frame_checks.h"
#include "algo/light/copied_spot.h"

namespace hord::algo {

// The largest share of a second spot in a ninth of the field: of a ghost that a part of the field shows, the rest would
// hide most. Less three standard errors of the dark bins' noise. A ghost of the limit's share, two bins away or
// farther, moves the mean deflection of what shows it by twice the limit. Where the ninths differ by less than half of
// that, it is not looked for, because that takes time.
double FrameChecks::second_share_of_places(const FrameView& frame, const DecodedField& field, const FoundPart& part) {
    constexpr int kPlaces = 3;            // along each axis
    constexpr int kMaxLooked = 48;        // lenslets of a ninth
    constexpr std::size_t kMinFree = 24;  // of these; one of them, with dirt before it, is 0.04
    struct Place {
        std::size_t begin = 0, end = 0;  // of chosen_
    };
    std::array<Place, static_cast<std::size_t>(kPlaces) * kPlaces> places{};
    std::size_t found = 0;
    double left_most = 0, right_most = 0, top_most = 0, bottom_most = 0;  // mean deflections, bins
    chosen_.clear();
    for (int place = 0; place < kPlaces * kPlaces; ++place) {
        const int left = place % kPlaces * extents_.m / kPlaces, right = (place % kPlaces + 1) * extents_.m / kPlaces,
                  top = place / kPlaces * extents_.n / kPlaces, bottom = (place / kPlaces + 1) * extents_.n / kPlaces;
        const int width = right - left, count = width * (bottom - top), step = (count + kMaxLooked - 1) / kMaxLooked;
        const std::size_t begin = chosen_.size();
        double x = 0, y = 0;
        for (int at = 0; at < count; at += step) {
            const std::size_t k = extents_.index(left + at % width, top + at / width);
            if ((field.mask[k] & kNoHord) != 0 || (part.state[k] & FoundPart::kFreeField) == 0) continue;
            chosen_.push_back(static_cast<std::uint32_t>(k));
            x += field.deflections[k].x.to_double_rounded();
            y += field.deflections[k].y.to_double_rounded();
        }
        const std::size_t free = chosen_.size() - begin;
        if (free < kMinFree) continue;
        x /= static_cast<double>(free), y /= static_cast<double>(free);
        left_most = found == 0 ? x : std::min(left_most, x), right_most = found == 0 ? x : std::max(right_most, x);
        top_most = found == 0 ? y : std::min(top_most, y), bottom_most = found == 0 ? y : std::max(bottom_most, y);
        places[found++] = {begin, chosen_.size()};
    }
    if (std::max(right_most - left_most, bottom_most - top_most) < 0.5 * kMinCopyBins * max_second_share_) return 0;
    double largest = 0;
    for (const Place& place : std::span(places).first(found)) {
        const auto lenslets = std::span(chosen_).subspan(place.begin, place.end - place.begin);
        const MeanSpot spot = mean_spot(frame, extents_, dark_dn_, lenslets);
        if (!spot.measured) continue;
        const double error = static_cast<double>(findings_.dark_noise_dn) *
            std::sqrt(extents_.bins() / static_cast<double>(lenslets.size())) / spot.light_dn;
        largest = std::max(largest, spot.second_share - 3 * error);
    }
    return largest;
}

}  // namespace hord::algo
