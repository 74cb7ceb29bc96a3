// The frames of the simulated sensor, from the part in view and the light of the strobe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "common/frame.h"

namespace hord::sim {

struct Exposure {
    static constexpr std::size_t kNoPart = SIZE_MAX;
    std::size_t kind = kNoPart;  // index into ScheduleOptions::kinds: one light field a kind
    std::uint64_t part = 0;      // the world's own number; 0: none
    bool bad = false;
    double offset_mm = 0;    // the part is this far past the centre of view
    double light = 1;        // 1: nominal, 0: dark, large: saturated
    std::uint64_t seed = 0;  // of this exposure's noise
};

class FrameSource {
  public:
    virtual ~FrameSource() = default;
    struct Format {
        int width_px = 0;
        int height_px = 0;
        int bits = 8;
    };
    [[nodiscard]] virtual Format format() const = 0;

    // Loop thread. Either fills `scratch` (rows unpadded, as large as the format needs) and returns a view of it, or
    // returns a view of samples of its own, which stay unchanged as long as the source lives.
    virtual FrameView expose(const Exposure& exposure, std::span<std::byte> scratch) = 0;
};

// Frames without optics, for tests and for millions of parts: the first samples encode the part in front of the camera,
// the others are constant. A stand-in inspector judges by them.
class TokenFrames final : public FrameSource {
  public:
    // At least 16 samples. A dark frame (light below a half) is all zero, a saturated one (light above 4) all full
    // scale.
    explicit TokenFrames(Format format) : format_(format) {}
    [[nodiscard]] Format format() const override { return format_; }
    FrameView expose(const Exposure& exposure, std::span<std::byte> scratch) override;

    struct Token {
        std::uint64_t part = 0;  // 0: an empty field
        std::size_t kind = Exposure::kNoPart;
        bool bad = false;
    };
    // Empty when the frame is dark, saturated, or not a token frame.
    static std::optional<Token> read(const FrameView& frame);

  private:
    Format format_;
};

}  // namespace hord::sim
