#include "hal_sim/world/frame_source.h"

#include <algorithm>
#include <array>

namespace hord::sim {
namespace {

// One byte a sample: a mark, the part (8 bytes, low byte first), the kind (255: none), bad, a checksum.
constexpr std::size_t kTokenSamples = 12;
constexpr std::uint8_t kMark = 0xA7;

std::uint8_t checksum(const std::array<std::uint8_t, kTokenSamples>& token) {
    unsigned sum = 1;
    for (std::size_t k = 0; k + 1 < kTokenSamples; ++k) sum = sum * 31 + token[k];
    return static_cast<std::uint8_t>(sum % 251);
}

}  // namespace

FrameView TokenFrames::expose(const Exposure& exposure, std::span<std::byte> scratch) {
    const FrameView view{scratch.data(), format_.width_px, format_.height_px,
                         static_cast<std::ptrdiff_t>(format_.width_px) * (format_.bits > 8 ? 2 : 1), format_.bits};
    const auto set = [&](std::size_t at, std::uint32_t value) {
        if (format_.bits > 8) {
            reinterpret_cast<std::uint16_t*>(scratch.data())[at] = static_cast<std::uint16_t>(value);
        } else {
            scratch[at] = static_cast<std::byte>(value);
        }
    };
    const std::size_t samples =
        static_cast<std::size_t>(format_.width_px) * static_cast<std::size_t>(format_.height_px);
    const bool dark = exposure.light<0.5, saturated = exposure.light> 4;
    const std::uint32_t ground = dark ? 0 : saturated ? view.full_scale() : view.full_scale() / 4;
    for (std::size_t k = 0; k < samples; ++k) set(k, ground);
    if (dark || saturated) return view;
    std::array<std::uint8_t, kTokenSamples> token{kMark};
    for (unsigned k = 0; k < 8; ++k) token[1 + k] = static_cast<std::uint8_t>(exposure.part >> (8 * k));
    token[9] = static_cast<std::uint8_t>(std::min<std::size_t>(exposure.kind, 255));
    token[10] = exposure.bad ? 1 : 0;
    token[11] = checksum(token);
    for (std::size_t k = 0; k < kTokenSamples; ++k) set(k, token[k]);
    return view;
}

std::optional<TokenFrames::Token> TokenFrames::read(const FrameView& frame) {
    if (frame.width_px * frame.height_px < static_cast<int>(kTokenSamples)) return std::nullopt;
    std::array<std::uint8_t, kTokenSamples> token{};
    for (int k = 0; k < static_cast<int>(kTokenSamples); ++k) {
        token[static_cast<std::size_t>(k)] =
            static_cast<std::uint8_t>(frame.sample(k % frame.width_px, k / frame.width_px));
    }
    if (token[0] != kMark || token[11] != checksum(token)) return std::nullopt;
    Token out;
    for (unsigned k = 0; k < 8; ++k) out.part |= std::uint64_t{token[1 + k]} << (8 * k);
    if (token[9] != 255) out.kind = token[9];
    out.bad = token[10] != 0;
    return out;
}

}  // namespace hord::sim
