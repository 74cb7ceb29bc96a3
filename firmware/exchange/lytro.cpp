#include "firmware/exchange/lytro.h"

#include <map>
#include <optional>
#include <string>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/frame_size.h"

namespace hord::firmware {
namespace {

using Json = nlohmann::json;
using Bytes = std::span<const std::byte>;

constexpr std::string_view kFile = "\x89LFP\r\n\x1a\n", kTable = "\x89LFM\r\n\x1a\n", kContent = "\x89LFC\r\n\x1a\n";
constexpr std::size_t kHead = 16;                       // magic, version, length
constexpr std::size_t kDigest = 45, kDigestPlace = 80;  // "sha1-" and 40 digits, padded with zeros

std::string_view text_of(Bytes bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

struct Sections {
    std::string_view table;
    std::map<std::string, Bytes, std::less<>> content;  // by digest
};

// None: a section is cut off.
std::optional<Sections> split(Bytes bytes) {
    Sections out;
    Bytes rest = bytes.subspan(std::min(kHead, bytes.size()));
    while (rest.size() >= kHead + kDigestPlace) {
        const std::string_view magic = text_of(rest.first(8));
        if (magic != kTable && magic != kContent) return std::nullopt;
        std::size_t length = 0;
        for (std::size_t k = 12; k < 16; ++k) length = length << 8U | std::to_integer<std::size_t>(rest[k]);
        const std::string digest(text_of(rest.subspan(kHead, kDigest)));
        rest = rest.subspan(kHead + kDigestPlace);
        if (length > rest.size()) return std::nullopt;
        if (magic == kTable) out.table = text_of(rest.first(length));
        else out.content.emplace(digest, rest.first(length));
        rest = rest.subspan(length);
        while (!rest.empty() && rest.front() == std::byte{0}) rest = rest.subspan(1);  // padding
    }
    return out.table.empty() ? std::nullopt : std::optional(out);
}

// The member at a path; null if there is none. Of an array its first element is taken.
const Json& at(const Json& json, std::initializer_list<const char*> path) {
    static const Json nothing;
    const Json* here = &json;
    for (const char* name : path) {
        if (here->is_array()) {
            if (here->empty()) return nothing;
            here = &here->front();
        }
        const auto found = here->is_object() ? here->find(name) : here->end();
        if (!here->is_object() || found == here->end()) return nothing;
        here = &*found;
    }
    return *here;
}
const Json& first_of(const Json& one, const Json& other) { return one.is_null() ? other : one; }

unsigned value(std::byte byte) { return std::to_integer<unsigned>(byte); }

// Two samples in three bytes, the first one's high bits first.
void unpack_12(Bytes from, Frame& to) {
    const int width = to.width_px();
    for (std::size_t k = 0, sample = 0; k + 2 < from.size(); k += 3) {
        const unsigned a = value(from[k]), b = value(from[k + 1]), c = value(from[k + 2]);
        for (const unsigned v : {a << 4U | b >> 4U, (b & 15U) << 8U | c}) {
            const auto at = static_cast<int>(sample++);
            to.set(at % width, at / width, v);
        }
    }
}

// Four bytes with the high bits of four samples, a fifth with their low bits, the first sample's lowest.
void unpack_10(Bytes from, Frame& to) {
    const int width = to.width_px();
    for (std::size_t k = 0, sample = 0; k + 4 < from.size(); k += 5) {
        const unsigned low = value(from[k + 4]);
        for (unsigned s = 0; s < 4; ++s) {
            const auto at = static_cast<int>(sample++);
            to.set(at % width, at / width, value(from[k + s]) << 2U | (low >> (2 * s) & 3U));
        }
    }
}

}  // namespace

bool is_lytro(Bytes bytes) { return text_of(bytes).starts_with(kFile); }

Result<Frame> decode_lytro(Bytes bytes, std::string_view name) {
    const auto damaged = [&](std::string_view what) {
        return fail(ErrorCode::unreadable, fmt::format("{} is truncated or damaged ({})", name, what), "copy it again");
    };
    const auto sections = split(bytes);
    if (!sections) return damaged("a section is cut off, or the table of contents is missing");
    const Json table = Json::parse(sections->table, nullptr, false);
    if (table.is_discarded()) return damaged("the table of contents is no JSON");
    const Json& frame = first_of(at(table, {"frames", "frame"}), at(table, {"picture", "frameArray", "frame"}));
    const Json &image_ref = at(frame, {"imageRef"}), &metadata_ref = at(frame, {"metadataRef"});
    if (!image_ref.is_string() || !metadata_ref.is_string()) {
        return fail(ErrorCode::unsupported, fmt::format("{} holds no raw frame", name),
                    "give the camera's own file; one that was processed has only pictures");
    }
    const auto image = sections->content.find(image_ref.get_ref<const std::string&>()),
               about = sections->content.find(metadata_ref.get_ref<const std::string&>());
    if (image == sections->content.end() || about == sections->content.end())
        return damaged("a section that the table of contents names is missing");
    const Json metadata = Json::parse(text_of(about->second), nullptr, false);
    const Json& says = at(metadata, {"image"});
    const Json& packing = first_of(at(says, {"rawDetails", "pixelPacking"}), at(says, {"pixelPacking"}));
    const Json &width = at(says, {"width"}), &height = at(says, {"height"}), &bits = at(packing, {"bitsPerPixel"}),
               &order = at(packing, {"endianness"});
    if (!width.is_number_unsigned() || !height.is_number_unsigned() || !bits.is_number_unsigned() || !order.is_string())
        return damaged("its metadata do not say how the samples are packed");
    const auto columns = width.get<std::uint64_t>(), rows = height.get<std::uint64_t>(),
               depth = bits.get<std::uint64_t>();
    if (columns == 0 || rows == 0 || columns > 65535 || rows > 65535 || columns * rows > common::kMaxFrameSamples)
        return damaged(fmt::format("a frame of {}x{} pixels", columns, rows));
    const bool of_12 = depth == 12 && order == "big", of_10 = depth == 10 && order == "little";
    if ((!of_12 && !of_10) || columns * rows % (of_12 ? 2 : 4) != 0) {
        return fail(ErrorCode::unsupported,
                    fmt::format("{} packs {} bits, {}-endian", name, depth, order.get<std::string>()),
                    "known are 12 bits big-endian (first generation) and 10 bits little-endian (Illum)");
    }
    if (image->second.size() < columns * rows * depth / 8) return damaged("samples are missing");
    Frame out(static_cast<int>(columns), static_cast<int>(rows), static_cast<int>(depth));
    const Bytes packed = image->second.first(columns * rows * depth / 8);
    of_12 ? unpack_12(packed, out) : unpack_10(packed, out);
    return out;
}

}  // namespace hord::firmware
