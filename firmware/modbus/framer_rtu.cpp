#include "firmware/modbus/framer_rtu.h"

#include <algorithm>

namespace hord::firmware::modbus {
namespace {

constexpr std::size_t kCrc = 2;

// The size of frames, without CRC, by function code.
struct FrameSize {
    std::uint8_t first, last;  // function codes
    std::size_t fixed;
    std::size_t count_at = 0;  // not 0: this byte counts those that follow it
};
constexpr FrameSize kRequests[] = {{1, 6, 6},       {7, 7, 2},   {8, 8, 6},      {11, 12, 2},
                                   {15, 16, 0, 6},  {17, 17, 2}, {20, 21, 0, 2}, {22, 22, 8},
                                   {23, 23, 0, 10}, {24, 24, 4}, {43, 43, 5}};
constexpr FrameSize kReplies[] = {{1, 4, 0, 2},   {5, 6, 6},      {7, 7, 3},      {8, 8, 6},
                                  {11, 11, 6},    {12, 12, 0, 2}, {15, 16, 6},    {17, 17, 0, 2},
                                  {20, 21, 0, 2}, {22, 22, 8},    {23, 23, 0, 2}, {0x80, 0xFF, 3}};

// Of the whole frame; 0: the byte that determines it has not arrived; empty: unknown function.
std::optional<std::size_t> size_of(std::span<const FrameSize> known, std::span<const std::uint8_t> frame) {
    if (frame.size() < 2) return 0;
    for (const FrameSize& size : known) {
        if (frame[1] < size.first || frame[1] > size.last) continue;
        if (size.count_at == 0) return size.fixed + kCrc;
        return frame.size() > size.count_at ? size.count_at + 1 + frame[size.count_at] + kCrc : 0;
    }
    return std::nullopt;
}

}  // namespace

std::uint16_t crc16(std::span<const std::uint8_t> bytes) {
    unsigned crc = 0xFFFF;
    for (const std::uint8_t byte : bytes) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0xA001U : 0U);
    }
    return static_cast<std::uint16_t>(crc);
}

void write_crc16(std::span<std::uint8_t> frame) {
    const std::uint16_t crc = crc16(frame.first(frame.size() - kCrc));
    frame[frame.size() - 2] = static_cast<std::uint8_t>(crc & 0xFFU);
    frame[frame.size() - 1] = static_cast<std::uint8_t>(crc >> 8U);
}

bool FramerRtu::good(std::size_t size) const {
    return crc16(std::span(frame_).first(size - kCrc)) == (frame_[size - 2] | frame_[size - 1] << 8U);
}

// A frame for this unit is a request. One for another unit is a request or a reply: the one whose CRC matches.
FramerRtu::Shape FramerRtu::shape(std::size_t& size) const {
    const auto there = std::span(frame_).first(filled_);
    const bool ours = filled_ > 0 && (frame_[0] == unit_ || frame_[0] == 0);
    bool possible = false;
    for (const auto& known : {size_of(kRequests, there), ours ? std::nullopt : size_of(kReplies, there)}) {
        if (!known || *known > kMaxRtuFrame) continue;
        if (*known == 0 || *known > filled_) {
            possible = true;
        } else if (good(*known)) {
            size = *known;
            return Shape::frame;
        }
    }
    return possible ? Shape::incomplete : Shape::damaged;
}

std::optional<Request> FramerRtu::take(std::span<const std::uint8_t>& bytes, hal::TimePoint at) {
    if (bytes.empty()) return std::nullopt;
    if (last_at_ && at - *last_at_ > gap_) {
        filled_ = 0;
        deaf_ = false;
    }
    last_at_ = at;
    while (!bytes.empty()) {
        if (deaf_) {
            bytes = {};
            break;
        }
        frame_[filled_++] = bytes.front();
        bytes = bytes.subspan(1);
        std::size_t size = 0;
        switch (shape(size)) {
            case Shape::incomplete: break;
            case Shape::damaged: deaf_ = true; break;
            case Shape::frame:
                filled_ = 0;
                if (frame_[0] != unit_ && frame_[0] != 0) break;
                return Request{.transaction = 0,
                               .unit = frame_[0],
                               .pdu = std::span<const std::uint8_t>(frame_).subspan(1, size - 1 - kCrc)};
        }
    }
    return std::nullopt;
}

}  // namespace hord::firmware::modbus
