#include "firmware/registers_image.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace hord::firmware {
namespace {

std::size_t map_size() {
    const Block& end = register_blocks().back();
    return std::size_t{end.base} + end.size();
}

}  // namespace

RegisterImage::RegisterImage(StationIdentity identity)
    : identity_(std::move(identity)),
      boot_text_(fmt::format("{:08X}", identity_.boot_id)),
      map_text_(fmt::format("{} {:08X}", kMapVersion, map_crc32())),
      staged_(map_size(), 0xFFFF),
      words_(map_size(), 0xFFFF) {
    publish(Snapshot{});
}

void RegisterImage::publish(const Snapshot& snapshot) {
    const std::lock_guard one_at_a_time(publishing_);
    const RegisterSource source{.identity = identity_, .snapshot = snapshot, .result = snapshot.last};
    for (const Block& block : register_blocks())
        encode(block, source, std::span(staged_).subspan(block.base, block.size()));
    const std::lock_guard no_reader(reading_);
    std::copy(staged_.begin(), staged_.end(), words_.begin());
}

modbus::Exception RegisterImage::read_registers(std::uint16_t address, std::span<std::uint16_t> out) {
    if (address + out.size() > words_.size()) return modbus::Exception::illegal_address;
    const std::lock_guard no_publisher(reading_);
    std::copy_n(words_.begin() + address, out.size(), out.begin());
    return modbus::Exception::none;
}

std::string_view RegisterImage::identification(std::uint8_t object) const {
    switch (object) {
        case 0x00:
            return identity_.vendor;
        case 0x01:
        case 0x04:
            return identity_.product;
        case 0x02:
            return identity_.firmware;
        case 0x80:
            return identity_.serial;
        case 0x81:
            return boot_text_;
        case 0x82:
            return map_text_;
        default:
            return {};
    }
}

}  // namespace hord::firmware
