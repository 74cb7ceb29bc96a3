#include "algo/reference/learning_frames.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "algo/reference/spread_estimate.h"

namespace hord::algo {
namespace {

constexpr double kShareOne = 1 << Reference::kShareBits;
constexpr double kDarkNoises = 2;  // standard deviations of a dark bin's reading
constexpr std::size_t kDarkFrames = 8;

}  // namespace

// A level so far above the frames' pedestal that most dark bins read nothing, and haze still shows in them
// (docs/adr/0020-dark-level-of-a-reference.md). A level that LearnOptions does not allow stays below it:
// lower() then lowers the frames.
Result<void> LearningFrames::choose_dark_level(Reference& reference) {
    double pedestal = static_cast<double>(options_.pedestal_dn);
    if (pedestal == 0) {
        std::vector<double> pedestals;
        for (std::size_t k = 0; k < std::min(count_, kDarkFrames); ++k) {
            const auto frame = frame_of_(k);
            if (!frame) return tl::unexpected(frame.error());
            if (auto fine = check_frame(frame->view(), extents_, reference.bits); !fine) return fine;
            const DarkBins dark = dark_bins_.measure(frame->view());
            pedestals.push_back(dark.measured && !dark.at_zero ? dark.pedestal_dn : 0);
        }
        pedestal = median_or_0(std::move(pedestals));
    }
    const double rounding = 0.5,
                 level = std::ceil(pedestal + kDarkNoises * static_cast<double>(options_.read_dn) - rounding);
    reference.levels.dark = std::min(static_cast<std::uint32_t>(std::max(level, 0.0)), options_.levels.dark);
    reference.sensor.clip_dn = static_cast<float>(std::max(level - pedestal, 0.0));
    return {};
}

// Subtracts what the frame's dark bins read above the dark level. Saturated samples stay.
void LearningFrames::lower(Frame& frame, const Reference& reference) {
    const LightLevels& levels = reference.levels;
    const std::uint32_t rise =
        options_.max_dark_rise_dn == 0 ? default_dark_rise(reference.bits) : options_.max_dark_rise_dn;
    const std::uint32_t above =
        levels_above_dark_bins(levels, dark_bins_.measure(frame.view()), rise).levels.dark - levels.dark;
    if (above == 0) return;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const std::uint32_t sample = frame.view().sample(x, y);
            if (sample < levels.saturated) frame.set(x, y, sample > above ? sample - above : 0);
        }
    }
}

Result<Frame> LearningFrames::lowered(std::size_t of, const Reference& reference) {
    auto frame = frame_of_(of);
    if (frame) lower(*frame, reference);
    return frame;
}

// Reads and decodes the frame of part `of`.
Result<Frame> LearningFrames::decode(std::size_t of, const Reference& reference, DecodedPart& part, bool with_shares) {
    auto frame = frame_of_(of);
    if (!frame) return frame;
    if (auto fine = check_frame(frame->view(), extents_, reference.bits); !fine) return tl::unexpected(fine.error());
    lower(*frame, reference);
    const std::size_t count = extents_.lenslets(), stride = reference.stride();
    part.sums.resize(count), part.deflections.resize(count), part.mask.resize(count);
    part.light.resize(count), part.x.resize(count), part.y.resize(count);
    if (with_shares) part.shares.assign(count * stride, 0);
    for (int n = 0; n < extents_.n; ++n) {
        decode_row(frame->view(), extents_, reference.levels, n, row_);
        const std::size_t at = extents_.index(0, n);
        mean_deflections(row_, std::span(part.deflections).subspan(at, static_cast<std::size_t>(extents_.m)));
        for (int m = 0; m < extents_.m; ++m) {
            const std::size_t k = at + static_cast<std::size_t>(m);
            const Hord hord = row_.hord(m);
            part.sums[k] = hord.sum;
            part.mask[k] = row_.mask()[static_cast<std::size_t>(m)];
            part.light[k] = static_cast<float>(hord.sum);
            part.x[k] = part.deflections[k].x.to_float_rounded();
            part.y[k] = part.deflections[k].y.to_float_rounded();
            if (!with_shares || !row_.has_hord(m)) continue;
            for (int b = 0; b < extents_.bins(); ++b) {
                part.shares[k * stride + reference.place(b % extents_.i, b / extents_.i)] =
                    static_cast<std::uint16_t>(std::lround(hord.mass[b] * kShareOne / hord.sum));
            }
        }
    }
    return frame;
}

}  // namespace hord::algo
