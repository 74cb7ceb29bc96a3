// A sensor's frame: unsigned grey samples of 8 to 16 bits, row by row.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace hord {

// Borrowed samples. 8-bit samples take one byte; 9- to 16-bit samples take two, little-endian, right-aligned
// (value range 0 .. 2^bits - 1). Rows may be padded: row y starts at data + y * stride_bytes.
struct FrameView {
    const std::byte* data = nullptr;
    int width_px = 0;
    int height_px = 0;
    std::ptrdiff_t stride_bytes = 0;
    int bits = 8;  // 8..16

    [[nodiscard]] int sample_bytes() const { return bits > 8 ? 2 : 1; }
    [[nodiscard]] std::uint32_t full_scale() const { return (1U << bits) - 1U; }
    [[nodiscard]] const std::uint8_t* row8(int y) const {
        return reinterpret_cast<const std::uint8_t*>(data + y * stride_bytes);
    }
    [[nodiscard]] const std::uint16_t* row16(int y) const {
        return reinterpret_cast<const std::uint16_t*>(data + y * stride_bytes);
    }
    [[nodiscard]] std::uint32_t sample(int x, int y) const { return bits > 8 ? row16(y)[x] : row8(y)[x]; }
};

// Owned samples, rows unpadded.
class Frame {
  public:
    Frame() = default;
    Frame(int width_px, int height_px, int bits)
        : width_px_(width_px), height_px_(height_px), bits_(bits),
          bytes_(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px) * (bits > 8 ? 2U : 1U)) {}

    [[nodiscard]] FrameView view() const {
        return {bytes_.data(), width_px_, height_px_, static_cast<std::ptrdiff_t>(width_px_) * (bits_ > 8 ? 2 : 1),
                bits_};
    }
    [[nodiscard]] int width_px() const { return width_px_; }
    [[nodiscard]] int height_px() const { return height_px_; }
    [[nodiscard]] int bits() const { return bits_; }
    [[nodiscard]] std::span<std::byte> bytes() { return bytes_; }
    [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }

    void set(int x, int y, std::uint32_t value) {
        const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px_) + static_cast<std::size_t>(x);
        if (bits_ > 8) {
            reinterpret_cast<std::uint16_t*>(bytes_.data())[at] = static_cast<std::uint16_t>(value);
        } else {
            reinterpret_cast<std::uint8_t*>(bytes_.data())[at] = static_cast<std::uint8_t>(value);
        }
    }

  private:
    int width_px_ = 0;
    int height_px_ = 0;
    int bits_ = 8;
    std::vector<std::byte> bytes_;
};

}  // namespace hord
