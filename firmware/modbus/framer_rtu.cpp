#include "firmware/modbus/framer_rtu.h"

#include <algorithm>

namespace hord::firmware::modbus {
namespace {

constexpr std::size_t kCrc = 2;

// Size of the whole frame; 0: the byte that determines it has not arrived; nothing: unknown function.
std::optional<std::size_t> request_size(std::span<const std::uint8_t> frame) {
    const auto counted = [&](std::size_t at) { return frame.size() > at ? at + 1 + frame[at] + kCrc : std::size_t{0}; };
    if (frame.size() < 2) return 0;
    switch (frame[1]) {
        case 1:
        case 2:
        case 3:
        case 4:
        case 5:
        case 6: return 6 + kCrc;
        case 7:
        case 11:
        case 12:
        case 17: return 2 + kCrc;
        case 8: return 6 + kCrc;
        case 15:
        case 16: return counted(6);
        case 20:
        case 21: return counted(2);
        case 22: return 8 + kCrc;
        case 23: return counted(10);
        case 24: return 4 + kCrc;
        case 43: return 5 + kCrc;
        default: return std::nullopt;
    }
}

std::optional<std::size_t> reply_size(std::span<const std::uint8_t> frame) {
    if (frame.size() < 2) return 0;
    if (frame[1] >= 0x80) return 3 + kCrc;
    switch (frame[1]) {
        case 1:
        case 2:
        case 3:
        case 4:
        case 12:
        case 17:
        case 20:
        case 21:
        case 23: return frame.size() > 2 ? 3 + frame[2] + kCrc : std::size_t{0};
        case 5:
        case 6:
        case 8:
        case 11:
        case 15:
        case 16: return 6 + kCrc;
        case 7: return 3 + kCrc;
        case 22: return 8 + kCrc;
        default: return std::nullopt;
    }
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
    for (const auto& known : {request_size(there), ours ? std::nullopt : reply_size(there)}) {
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
        if (filled_ > 0) ++damaged_;
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
            case Shape::damaged:
                ++damaged_;
                filled_ = 0;
                deaf_ = true;
                break;
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
