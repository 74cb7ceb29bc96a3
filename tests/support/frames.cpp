#include "tests/support/frames.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace hord::algo::testing {
namespace {

std::uint32_t clamped(double value, int bits) {
    return static_cast<std::uint32_t>(std::clamp(std::lround(value), 0L, (1L << bits) - 1));
}

template <class Change>
Frame changed(const Frame& frame, int width, int height, int bits, Change&& sample) {
    Frame out(width, height, bits);
    const FrameView view = frame.view();
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) out.set(x, y, sample(view, x, y));
    }
    return out;
}

// Share of [from, to] in bin k of `bins`, bins counted from the centre.
double overlap(double from, double to, int k, int bins) {
    const double left = k - (bins - 1) / 2.0 - 0.5;
    return std::max(0.0, std::min(to, left + 1) - std::max(from, left));
}

}  // namespace

std::optional<Frame> povray(const std::string& name) {
    const char* data = std::getenv("HORD_DATA");
    const std::filesystem::path root =
        data != nullptr ? std::filesystem::path(data) : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data";
    const std::filesystem::path file = root / "povray" / (name + "_raw.png");
    if (!std::filesystem::exists(file)) return std::nullopt;
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
    if (image.type() != CV_8UC1 && image.type() != CV_16UC1) return std::nullopt;
    const bool wide = image.type() == CV_16UC1;
    Frame frame(image.cols, image.rows, wide ? 16 : 8);
    for (int y = 0; y < image.rows; ++y) {
        for (int x = 0; x < image.cols; ++x)
            frame.set(x, y, wide ? image.at<std::uint16_t>(y, x) : image.at<std::uint8_t>(y, x));
    }
    return frame;
}

Frame drawn(const Extents& e, int bits, double full_bin_dn, const std::function<Spot(int m, int n)>& spot) {
    constexpr double kHalfWidth = 0.61;
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const Spot s = spot(m, n);
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    const double share = overlap(s.x - kHalfWidth, s.x + kHalfWidth, i, e.i) *
                        overlap(s.y - kHalfWidth, s.y + kHalfWidth, j, e.j);
                    frame.set(m * e.i + i, n * e.j + j, clamped(share * s.light * full_bin_dn, bits));
                }
            }
        }
    }
    return frame;
}

std::function<Spot(int, int)> lens(const Extents& e, double radius, double rim_bins) {
    return [=](int m, int n) -> Spot {
        const double right = m - (e.m - 1) / 2.0, down = n - (e.n - 1) / 2.0;
        if (std::hypot(right, down) > radius) return {};
        return {-right / radius * rim_bins, -down / radius * rim_bins, 1};
    };
}

Frame noisy(const Frame& frame, const Noise& noise, std::uint64_t seed, int bits) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const double scale = ((1 << bits) - 1) / static_cast<double>((1 << frame.bits()) - 1);
    return changed(frame, frame.width_px(), frame.height_px(), bits, [&](const FrameView& view, int x, int y) {
        const double mean = view.sample(x, y) * noise.light * noise.electrons_per_dn;
        double electrons = 0;  // from 200 on, the normal distribution is close to Poisson and faster to draw
        if (mean >= 200) electrons = mean + std::sqrt(mean) * normal(random);
        else if (mean > 0) electrons = std::poisson_distribution<int>(mean)(random);
        electrons += noise.read_electrons * normal(random);
        return clamped(electrons / noise.electrons_per_dn * scale, bits);
    });
}

Frame at_bits(const Frame& frame, int bits) {
    const double scale = ((1 << bits) - 1) / static_cast<double>((1 << frame.bits()) - 1);
    return changed(frame, frame.width_px(), frame.height_px(), bits,
                   [&](const FrameView& view, int x, int y) { return clamped(view.sample(x, y) * scale, bits); });
}

Frame transposed(const Frame& frame) {
    return changed(frame, frame.height_px(), frame.width_px(), frame.bits(),
                   [](const FrameView& view, int x, int y) { return view.sample(y, x); });
}

Frame mirrored(const Frame& frame) {
    return changed(frame, frame.width_px(), frame.height_px(), frame.bits(),
                   [](const FrameView& view, int x, int y) { return view.sample(view.width_px - 1 - x, y); });
}

Frame shifted(const Frame& frame, const Extents& e, int dm, int dn) {
    return changed(frame, frame.width_px(), frame.height_px(), frame.bits(), [&](const FrameView& view, int x, int y) {
        const int from_x = x - dm * e.i, from_y = y - dn * e.j;
        const bool inside = from_x >= 0 && from_y >= 0 && from_x < view.width_px && from_y < view.height_px;
        return inside ? view.sample(from_x, from_y) : view.sample(x % e.i, y % e.j);
    });
}

Frame specked(const Frame& frame, const Extents& e, double m, double n, double radius, double transmission) {
    constexpr int kSub = 8;
    return changed(frame, frame.width_px(), frame.height_px(), frame.bits(), [&](const FrameView& view, int x, int y) {
        int covered = 0;
        for (int b = 0; b < kSub; ++b) {
            for (int a = 0; a < kSub; ++a) {
                const int column = x / e.i, row = y / e.j;  // of the lenslet
                const double right = column - 0.5 + (a + 0.5) / kSub - m, down = row - 0.5 + (b + 0.5) / kSub - n;
                if (right * right + down * down <= radius * radius) ++covered;
            }
        }
        const double share = covered / static_cast<double>(kSub * kSub);
        return clamped(view.sample(x, y) * (1 - share * (1 - transmission)), view.bits);
    });
}

}  // namespace hord::algo::testing
