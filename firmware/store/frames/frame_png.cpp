#include "firmware/store/frames/frame_png.h"

#include <iterator>
#include <utility>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "firmware/store/results/hash_chain.h"

namespace hord::firmware::store {
namespace {

constexpr char kKeyword[] = "hord";

}  // namespace

Result<std::vector<std::uint8_t>> encode_png(const FrameView& frame, std::string_view metadata, int level) {
    return common::encode_grey_png(frame, {.level = level, .runs_only = false},
                                   common::PngNote{kKeyword, std::string(metadata)});
}

Result<AnnotatedFrame> decode_png(std::span<const std::uint8_t> bytes, const std::string& name) {
    constexpr const char* kLeaveOut = "leave it out; nothing of it can be trusted";
    auto png = common::decode_grey_png(bytes, name, kKeyword);
    if (!png) return fail(png.error().code, png.error().what, kLeaveOut);
    if (png->length != bytes.size())
        return fail(ErrorCode::unreadable, name + " is damaged (something follows its end)", kLeaveOut);
    if (!png->note)
        return fail(ErrorCode::unreadable, name + " says nothing of its part", "name frames that a station has kept");
    return AnnotatedFrame{std::move(png->frame), std::move(*png->note)};
}

Result<AnnotatedFrame> read_annotated_frame(const std::filesystem::path& file) {
    const auto read = common::read_file(file);
    if (!read)
        return fail(ErrorCode::not_found, file.string() + " cannot be read", "check the path and its permissions");
    return decode_png(std::vector<std::uint8_t>(read->begin(), read->end()), file.string());
}

std::string digest_of_samples(const FrameView& frame) {
    const auto row_bytes = static_cast<std::size_t>(frame.width_px) * static_cast<std::size_t>(frame.sample_bytes());
    Sha256 sum;
    for (int y = 0; y < frame.height_px; ++y) sum.add({frame.row8(y), row_bytes});
    return to_hex(sum.digest());
}

}  // namespace hord::firmware::store
