#include "algo/frame/extents.h"

#include <charconv>

namespace hord::algo {
namespace {

bool within(int value, int low, int high) { return value >= low && value <= high; }

std::string times(int a, int b) { return std::to_string(a) + "x" + std::to_string(b); }

}  // namespace

std::optional<std::pair<int, int>> parse_bins(std::string_view text) {
    int i = 0, j = 0;
    const char* end = text.data() + text.size();
    const auto first = std::from_chars(text.data(), end, i);
    if (first.ec != std::errc() || first.ptr == end || *first.ptr != 'x') return std::nullopt;
    const auto second = std::from_chars(first.ptr + 1, end, j);
    if (second.ec != std::errc() || second.ptr != end) return std::nullopt;
    if (!within(i, kMinBins, kMaxBins) || !within(j, kMinBins, kMaxBins)) return std::nullopt;
    return std::pair(i, j);
}

Result<void> check(const Extents& extents) {
    if (!within(extents.i, kMinBins, kMaxBins) || !within(extents.j, kMinBins, kMaxBins)) {
        return fail(ErrorCode::invalid_argument, "a lenslet of " + times(extents.i, extents.j) + " bins",
                    "use 3 to 15 bins a side");
    }
    if (!within(extents.m, kMinLenslets, kMaxLenslets) || !within(extents.n, kMinLenslets, kMaxLenslets)) {
        return fail(ErrorCode::invalid_argument, "a light field of " + times(extents.m, extents.n) + " lenslets",
                    "use 3 to 2048 lenslets a side");
    }
    return {};
}

Result<Extents> extents_of_frame(int width_px, int height_px, int bins_i, int bins_j) {
    if (bins_i <= 0 || bins_j <= 0 || width_px % bins_i != 0 || height_px % bins_j != 0) {
        return fail(
            ErrorCode::invalid_argument,
            "macro-pixels of " + times(bins_i, bins_j) + " do not divide a frame of " + times(width_px, height_px),
            "give the number of bins a lenslet that this frame was recorded with");
    }
    const Extents extents{width_px / bins_i, height_px / bins_j, bins_i, bins_j};
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    return extents;
}

}  // namespace hord::algo
