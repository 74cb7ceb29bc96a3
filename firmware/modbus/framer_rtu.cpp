#include "firmware/modbus/framer_rtu.h"

#include <algorithm>

#include "common/crc16.h"

namespace hord::firmware::modbus {
namespace {

using common::kCrc16Bytes;

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
        if (size.count_at == 0) return size.fixed + kCrc16Bytes;
        return frame.size() > size.count_at ? size.count_at + 1 + frame[size.count_at] + kCrc16Bytes : 0;
    }
    return std::nullopt;
}

}  // namespace

bool FramerRtu::good(std::size_t size) const { return common::ends_with_crc16(std::span(frame_).first(size)); }

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
                               .pdu = std::span<const std::uint8_t>(frame_).subspan(1, size - 1 - kCrc16Bytes)};
        }
    }
    return std::nullopt;
}

}  // namespace hord::firmware::modbus
