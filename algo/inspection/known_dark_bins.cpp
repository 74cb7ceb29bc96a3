#include "algo/inspection/known_dark_bins.h"

#include <algorithm>
#include <functional>
#include <map>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr float kLight8Bit =
    1.0F / 16;  // DN at 8 bits, mean over the lenslets around: less is single readings of noise

// Whether good parts leave the bins of lenslet (m, n) dark, bin by bin. None where the reference does not know.
std::vector<bool> dark_bins_of(const Reference& r, int m, int n) {
    const Extents& e = r.extents;
    std::vector<float> light(static_cast<std::size_t>(e.bins()));
    float lenslets = 0;
    bool known = true;
    e.for_each_around(m, n, KnownDarkBins::kLensletsAround, [&](int x, int y) {
        const std::size_t k = e.index(x, y);
        known = known && r.mask[k] == kValid;
        lenslets += 1;
        for (int b = 0; b < e.bins(); ++b)
            light[static_cast<std::size_t>(b)] +=
                r.light[k] * 0x1p-15F * static_cast<float>(r.shares[k * r.stride() + r.place(b % e.i, b / e.i)]);
    });
    std::vector<bool> dark(light.size(), known);
    const float least = lenslets * kLight8Bit * static_cast<float>(1U << static_cast<unsigned>(r.bits - 8));
    constexpr int kNear = KnownDarkBins::kBinsFromLight - 1;
    for (int b = 0; b < e.bins(); ++b) {
        if (light[static_cast<std::size_t>(b)] < least) continue;
        const int i = b % e.i, j = b / e.i;
        for (int q = std::max(j - kNear, 0); q <= std::min(j + kNear, e.j - 1); ++q) {
            for (int p = std::max(i - kNear, 0); p <= std::min(i + kNear, e.i - 1); ++p)
                dark[static_cast<std::size_t>(q * e.i + p)] = false;
        }
    }
    return dark;
}

}  // namespace

KnownDarkBins::KnownDarkBins(const Reference& reference, const DarkBinMeter& sampled)
    : rare_share_(reference.sensor.read_dn > 0 ? kRareShare : kRareShareOfQuiet) {
    const Extents& e = reference.extents;
    const int columns = (std::min(e.m, DarkBinMeter::kSampled) + kBlock - 1) / kBlock;
    std::map<int, std::vector<Place>> of_blocks;
    int at = 0;
    sampled.for_each_sampled([&](int m, int n) {
        const int across = std::min(e.m, DarkBinMeter::kSampled), column = at % across, row = at / across;
        ++at;
        const std::vector<bool> dark = dark_bins_of(reference, m, n);
        for (int b = 0; b < e.bins(); ++b) {
            if (!dark[static_cast<std::size_t>(b)]) continue;
            of_blocks[row / kBlock * columns + column / kBlock].push_back(
                {static_cast<std::uint16_t>(m * e.i + b % e.i), static_cast<std::uint16_t>(n * e.j + b / e.i)});
        }
    });
    for (const auto& [block, places] : of_blocks) {
        if (places.size() < kMinReadings) continue;
        blocks_.push_back({places_.size(), places_.size() + places.size()});
        places_.insert(places_.end(), places.begin(), places.end());
    }
    levels_.reserve(blocks_.size());
    above_.reserve(places_.size());
}

template <class Sample>
void KnownDarkBins::find_levels(const FrameView& frame, std::uint32_t lowest) {
    levels_.clear();
    for (const Block& block : blocks_) {
        above_.clear();
        for (std::size_t k = block.first; k < block.end; ++k) {
            const auto* const line = reinterpret_cast<const Sample*>(frame.data + places_[k].y * frame.stride_bytes);
            if (const std::uint32_t reading = line[places_[k].x]; reading > lowest) above_.push_back(reading);
        }
        const auto allowed = static_cast<std::size_t>(rare_share_ * static_cast<double>(block.end - block.first));
        if (above_.size() <= allowed) {
            levels_.push_back(lowest);
            continue;
        }
        const auto nth = above_.begin() + static_cast<std::ptrdiff_t>(allowed);
        std::ranges::nth_element(above_, nth, std::greater());
        levels_.push_back(*nth);
    }
}

std::uint32_t KnownDarkBins::level_of(const FrameView& frame, std::uint32_t lowest, std::uint32_t highest) {
    if (!any()) return lowest;
    if (frame.bits > 8) find_levels<std::uint16_t>(frame, lowest);
    else find_levels<std::uint8_t>(frame, lowest);
    const auto quarter = levels_.begin() + static_cast<std::ptrdiff_t>((levels_.size() - 1) / 4);
    std::ranges::nth_element(levels_, quarter);
    return std::clamp(*quarter, lowest, std::max(lowest, highest));
}

}  // namespace hord::algo
