#include "lab/experiment/inspected_maps.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "common/hash.h"
#include "lab/report/statistics.h"

namespace hord::lab {
namespace {

// Calls use(k) for every lenslet within `reach` of the defect's centre.
template <class Use>
void around(const algo::Extents& e, const TruthDefect& defect, double reach, const Use& use) {
    const int m0 = std::max(0, static_cast<int>(std::floor(defect.m - reach))),
              m1 = std::min(e.m - 1, static_cast<int>(std::ceil(defect.m + reach)));
    const int n0 = std::max(0, static_cast<int>(std::floor(defect.n - reach))),
              n1 = std::min(e.n - 1, static_cast<int>(std::ceil(defect.n + reach)));
    for (int n = n0; n <= n1; ++n) {
        for (int m = m0; m <= m1; ++m) {
            if (std::hypot(m - defect.m, n - defect.n) <= reach) use(static_cast<std::size_t>(n * e.m + m));
        }
    }
}

// Number of lenslets of a window that are `in`, or enclosed by such lenslets.
std::size_t filled_area(std::vector<std::uint8_t> in, int width, int height) {
    constexpr std::uint8_t kReached = 2;
    std::vector<int> queue;
    const auto visit = [&](int x, int y) {
        if (x < 0 || y < 0 || x >= width || y >= height) return;
        const int k = y * width + x;
        if (in[static_cast<std::size_t>(k)] != 0) return;
        in[static_cast<std::size_t>(k)] = kReached;
        queue.push_back(k);
    };
    for (int x = 0; x < width; ++x) visit(x, 0), visit(x, height - 1);
    for (int y = 0; y < height; ++y) visit(0, y), visit(width - 1, y);
    while (!queue.empty()) {
        const int x = queue.back() % width, y = queue.back() / width;
        queue.pop_back();
        visit(x - 1, y), visit(x + 1, y), visit(x, y - 1), visit(x, y + 1);
    }
    return static_cast<std::size_t>(std::ranges::count_if(in, [](std::uint8_t v) { return v != kReached; }));
}

}  // namespace

Result<InspectedMaps> inspect_frame(const Frame& frame, const algo::Extents& extents, int threads,
                                    const algo::Recipe& recipe) {
    auto pipeline = algo::Pipeline::create(extents, frame.bits(), recipe, threads, algo::MapSet::exact);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto found = pipeline->inspect(frame.view());
    if (!found) return tl::unexpected(found.error());
    return InspectedMaps{extents,
                         {found->emd.begin(), found->emd.end()},
                         {found->frobenius.begin(), found->frobenius.end()},
                         {found->transmission.begin(), found->transmission.end()},
                         {found->mask.begin(), found->mask.end()},
                         found->verdict,
                         static_cast<double>(found->score)};
}

Frame with_dark_as_uniform(const Frame& frame, const InspectedMaps& maps) {
    Frame filled = frame;
    const algo::Extents& e = maps.extents;
    const std::uint32_t even = frame.view().full_scale() / 8;
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            if ((maps.mask[static_cast<std::size_t>(n * e.m + m)] & algo::kDark) == 0) continue;
            for (int k = 0; k < e.bins(); ++k) filled.set(m * e.i + k % e.i, n * e.j + k / e.i, even);
        }
    }
    return filled;
}

Interior interior_of(std::span<const float> signal, std::span<const std::uint8_t> mask) {
    std::vector<double> values;
    double sum = 0, squares = 0;
    for (std::size_t k = 0; k < signal.size(); ++k) {
        if (mask[k] != algo::kValid) continue;
        const double value = static_cast<double>(signal[k]);
        values.push_back(value);
        sum += value;
        squares += value * value;
    }
    if (values.empty()) return {};
    const auto count = static_cast<double>(values.size());
    const double mean = sum / count;
    std::ranges::sort(values);
    const auto at = [&](double share) { return values[static_cast<std::size_t>(share * (count - 1))]; };
    return {at(0.5), at(0.99), mean, std::sqrt(std::max(0.0, squares / count - mean * mean))};
}

Contrast contrast_of(std::span<const float> signal, std::span<const std::uint8_t> mask, const algo::Extents& extents,
                     const TruthDefect& defect, const Interior& clean, double floor) {
    Contrast contrast;
    const auto has_value = [&](std::size_t k) { return (mask[k] & algo::kNoGradient) == 0; };
    around(extents, defect, defect.radius_lenslets + 3, [&](std::size_t k) {
        if (has_value(k)) contrast.peak = std::max(contrast.peak, static_cast<double>(signal[k]));
    });
    double sum = 0, count = 0;
    around(extents, defect, defect.radius_lenslets + 1.5, [&](std::size_t k) {
        if (has_value(k)) sum += static_cast<double>(signal[k]), count += 1;
    });
    const double nothing = std::max(clean.p99, floor);
    contrast.ratio = contrast.peak / nothing;
    contrast.seen = contrast.ratio >= kVisible;
    if (count > 0) contrast.to_noise = (sum / count - clean.mean) / std::max(clean.sigma, floor / 3);

    const int half = static_cast<int>(std::ceil(2 * defect.radius_lenslets)) + 8;
    const int m0 = static_cast<int>(std::lround(defect.m)) - half, n0 = static_cast<int>(std::lround(defect.n)) - half,
              side = 2 * half + 1;
    std::vector<std::uint8_t> above(static_cast<std::size_t>(side * side)), closed = above;
    for (int y = 0; y < side; ++y) {
        for (int x = 0; x < side; ++x) {
            const int m = m0 + x, n = n0 + y;
            if (m < 0 || n < 0 || m >= extents.m || n >= extents.n) continue;
            const auto k = static_cast<std::size_t>(n * extents.m + m);
            const auto at = static_cast<std::size_t>(y * side + x);
            above[at] = has_value(k) && static_cast<double>(signal[k]) >= kVisible * nothing ? 1 : 0;
            const bool is_edge = m == 0 || n == 0 || m == extents.m - 1 || n == extents.n - 1;  // never has a value
            closed[at] = has_value(k) || is_edge ? above[at] : 1;
        }
    }
    const auto radius_of = [&](std::vector<std::uint8_t> in) {
        return std::sqrt(static_cast<double>(filled_area(std::move(in), side, side)) / std::numbers::pi);
    };
    contrast.blob_radius = radius_of(std::move(above));
    contrast.closed_radius = radius_of(std::move(closed));
    return contrast;
}

std::string hash_of(std::span<const std::byte> bytes) {
    common::Fnv1a64 hash;
    hash.add(bytes);
    return fmt::format("{:016x}", hash.value());
}
std::string hash_of(std::span<const float> values) { return hash_of(std::as_bytes(values)); }

}  // namespace hord::lab
