#include "calib/lattice/white_image.h"

#include <algorithm>
#include <cstring>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

namespace hord::calib {
namespace {

constexpr int kSmallestSide = 24;

// Eight samples at a time: GCC does not vectorise this at -O2.
template <class Sample, class Action>
void each_of_row(const Sample* from, float* to, int count, Action action) {
    typedef Sample Samples __attribute__((vector_size(8 * sizeof(Sample))));
    typedef float Floats __attribute__((vector_size(8 * sizeof(float))));
    int k = 0;
    for (; k + 8 <= count; k += 8) {
        Samples samples;
        Floats floats;
        std::memcpy(&samples, from + k, sizeof samples);
        std::memcpy(&floats, to + k, sizeof floats);
        floats = action(floats, __builtin_convertvector(samples, Floats));
        std::memcpy(to + k, &floats, sizeof floats);
    }
    for (; k < count; ++k) to[k] = action(to[k], static_cast<float>(from[k]));
}
template <class Sample>
void copy_row(const Sample* from, float* to, int count) {
    each_of_row(from, to, count, [](auto, auto sample) { return sample; });
}
template <class Sample>
void subtract_row(const Sample* from, float* to, int count) {
    each_of_row(from, to, count, [](auto light, auto sample) { return light - sample; });
}

constexpr std::size_t kFewestSteps = 64;  // values that occur in a frame: fewer, and rounding makes tops flat
constexpr std::size_t kBelowTop = 4;      // of them, those next below the maximum
constexpr double kPile = 8;               // samples at the maximum over those at each value next below it

// The saturation level, from every 4th pixel. Full scale; or the maximum below it, where samples pile up as clipping
// lets them: more than 1 in 2000 have it, and several times as many as each value next below it. The rounded tops of a
// dim or flat frame, which has few values, are no such pile. `any`: there are saturated samples.
std::uint32_t ceiling(const FrameView& frame, bool& any) {
    std::vector<std::int64_t> counts(static_cast<std::size_t>(frame.full_scale()) + 1);
    std::int64_t seen = 0;
    for (int y = 0; y < frame.height_px; y += 2) {
        for (int x = 0; x < frame.width_px; x += 2) {
            ++counts[std::min<std::size_t>(frame.sample(x, y), counts.size() - 1)];
            ++seen;
        }
    }
    any = counts.back() > 0;
    if (any) return frame.full_scale();
    std::size_t top = counts.size() - 1;
    while (top > 0 && counts[top] == 0) --top;
    std::size_t steps = 0;
    std::int64_t below = 0;  // samples of the values next below the maximum
    for (std::size_t value = top; value-- > 0;) {
        if (counts[value] > 0 && steps++ < kBelowTop) below += counts[value];
    }
    any = steps >= kFewestSteps && counts[top] * 2000 > seen &&
        static_cast<double>(counts[top] * static_cast<std::int64_t>(kBelowTop)) > kPile * static_cast<double>(below);
    return any ? static_cast<std::uint32_t>(top) : frame.full_scale();
}

}  // namespace

namespace {

// Two white frames of one cell differ by less; the light of a white frame is many times the sensor's offset.
constexpr double kMinWhiteOverDark = 1.01;

// The sum of all samples, DN.
double light_of(const FrameView& frame) {
    double sum = 0;
    for (int y = 0; y < frame.height_px; ++y) {
        for (int x = 0; x < frame.width_px; ++x) sum += static_cast<double>(frame.sample(x, y));
    }
    return sum;
}

}  // namespace

Result<WhiteImage> WhiteImage::open(const FrameView& white, const std::optional<FrameView>& dark,
                                    const std::optional<FrameView>& flat) {
    if (white.data == nullptr || white.width_px < kSmallestSide || white.height_px < kSmallestSide) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("a white frame of {}x{} px", white.width_px, white.height_px),
                    "use a frame of at least 24x24 px");
    }
    for (const auto& [name, frame] : {std::pair{"dark", &dark}, {"flat", &flat}}) {
        if (!*frame || ((*frame)->width_px == white.width_px && (*frame)->height_px == white.height_px)) continue;
        return fail(ErrorCode::invalid_argument,
                    fmt::format("a {} frame of {}x{} px for a white frame of {}x{} px", name, (*frame)->width_px,
                                (*frame)->height_px, white.width_px, white.height_px),
                    "record all of them with the same region of the sensor");
    }
    for (const auto& [name, frame] : {std::pair{"dark", &dark}, {"flat", &flat}}) {
        if (!*frame || (*frame)->sample_bytes() == white.sample_bytes()) continue;
        return fail(ErrorCode::invalid_argument,
                    fmt::format("a {} frame of {} bits for a white frame of {} bits: a sample means another light",
                                name, (*frame)->bits, white.bits),
                    "record all of them with the same pixel format");
    }
    if (dark && !(light_of(white) > kMinWhiteOverDark * light_of(*dark))) {
        return fail(ErrorCode::invalid_argument, "the dark frame is as bright as the white one",
                    "record it without light, as long exposed as the white frame");
    }
    WhiteImage image;
    image.white_ = white;
    image.dark_ = dark;
    if (flat && !image.learn_gain(*flat)) {
        return fail(ErrorCode::invalid_argument, "the flat frame is as dark as the dark one",
                    "record it in even light, without lenslets, below saturation");
    }
    image.saturated_dn_ = ceiling(white, image.any_saturated_);
    return image;
}

WhiteImage WhiteImage::smoothed(double sigma_px) const {
    std::vector<float> smooth(static_cast<std::size_t>(width_px()) * static_cast<std::size_t>(height_px()));
    window(0, 0, width_px(), height_px(), smooth.data(), width_px());
    cv::Mat light(height_px(), width_px(), CV_32F, smooth.data());
    cv::GaussianBlur(light, light, {0, 0}, sigma_px);
    WhiteImage out = *this;
    out.smooth_ = std::move(smooth);
    out.smoothed_px_ = sigma_px;
    return out;
}

float WhiteImage::at(int x, int y) const {
    if (!smooth_.empty())
        return smooth_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px()) +
                       static_cast<std::size_t>(x)];
    const auto light = static_cast<float>(white_.sample(x, y));
    const float net = dark_ ? light - static_cast<float>(dark_->sample(x, y)) : light;
    return gain_.empty()
        ? net
        : net * gain_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px()) + static_cast<std::size_t>(x)];
}

// Pixels below a tenth of the mean are dead: their gain is 0.
bool WhiteImage::learn_gain(const FrameView& flat) {
    std::vector<float> answer;
    answer.reserve(static_cast<std::size_t>(flat.width_px) * static_cast<std::size_t>(flat.height_px));
    double sum = 0;
    for (int y = 0; y < flat.height_px; ++y) {
        for (int x = 0; x < flat.width_px; ++x) {
            const auto light = static_cast<float>(flat.sample(x, y));
            answer.push_back(dark_ ? light - static_cast<float>(dark_->sample(x, y)) : light);
            sum += answer.back();
        }
    }
    const auto mean = static_cast<float>(sum / static_cast<double>(answer.size()));
    if (!(mean > 0)) return false;
    for (float& value : answer) value = value > 0.1F * mean ? mean / value : 0.0F;
    gain_ = std::move(answer);
    return true;
}

void WhiteImage::window(int x, int y, int width, int height, float* out, int stride) const {
    const int first = std::clamp(-x, 0, width);
    const int last = std::clamp(width_px() - x, first, width);
    for (int row = 0; row < height; ++row) {
        float* to = out + row * stride;
        const int from_y = y + row;
        if (from_y < 0 || from_y >= height_px()) {
            std::fill(to, to + width, 0.0F);
            continue;
        }
        std::fill(to, to + first, 0.0F);
        std::fill(to + last, to + width, 0.0F);
        const int count = last - first;
        if (!smooth_.empty()) {
            std::copy_n(smooth_.data() + static_cast<std::ptrdiff_t>(from_y) * width_px() + x + first, count,
                        to + first);
            continue;
        }
        // Windows are read from left to right, with rows pages apart: hardware does not prefetch them.
        __builtin_prefetch(white_.data + from_y * white_.stride_bytes +
                           std::clamp(x + 2 * width, 0, width_px() - 1) * white_.sample_bytes());
        const auto copy = [&](const FrameView& frame, auto action8, auto action16) {
            if (frame.bits > 8) action16(frame.row16(from_y) + x + first, to + first, count);
            else action8(frame.row8(from_y) + x + first, to + first, count);
        };
        copy(white_, copy_row<std::uint8_t>, copy_row<std::uint16_t>);
        if (dark_) copy(*dark_, subtract_row<std::uint8_t>, subtract_row<std::uint16_t>);
        if (gain_.empty()) continue;
        const float* gain = gain_.data() + static_cast<std::ptrdiff_t>(from_y) * width_px() + x + first;
        for (int k = 0; k < count; ++k) to[first + k] *= gain[k];
    }
}

}  // namespace hord::calib
