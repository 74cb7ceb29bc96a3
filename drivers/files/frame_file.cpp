#include "drivers/files/frame_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "algo/frame/extents.h"
#include "common/dangling_link.h"
#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/regular_file.h"
#include "common/tiff_codec.h"

namespace hord::drivers {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::byte>;

constexpr char kKeyword[] = "hord";  // of the iTXt chunk, as in the frames that a station keeps

// Hidden files are none: other systems put one beside each file (._a.png).
bool looks_like_a_frame(const fs::path& file) {
    if (file.filename().string().starts_with('.')) return false;
    std::string extension = file.extension().string();
    std::ranges::transform(extension, extension.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 4> known = {".png", ".tif", ".tiff", ".pgm"};
    return std::ranges::find(known, extension) != known.end();
}

std::string size_text(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

Result<Bytes> read_bytes(const fs::path& file) {
    std::error_code error;
    const fs::file_status status = fs::status(file, error);
    if (status.type() == fs::file_type::not_found) {
        const std::string link = common::dangling_link(file);
        if (link.empty()) return fail(ErrorCode::not_found, file.string() + " does not exist", "check the path");
        return fail(ErrorCode::not_found, link, "put that file back, or remove the link");
    }
    if (status.type() == fs::file_type::directory) {
        return fail(ErrorCode::unreadable, file.string() + " is a folder",
                    "name the frames in it, such as " + (file / "*.png").string());
    }
    if (status.type() != fs::file_type::regular) {
        const char* const what = common::name_of_irregular(status.type());
        if (what != nullptr)
            return fail(ErrorCode::unreadable, file.string() + " is " + what + ", not a regular file",
                        "name frames alone, or move it away");
        return fail(ErrorCode::unreadable, file.string() + " is not a file that can be read",
                    "check the path and its permissions");
    }
    std::ifstream in(file, std::ios::binary);
    Bytes bytes(in ? static_cast<std::size_t>(fs::file_size(file, error)) : 0);
    if (!in || error || !in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()))) {
        return fail(ErrorCode::unreadable, file.string() + " cannot be read", "check its permissions");
    }
    return bytes;
}

Result<void> check_size(const std::string& name, std::uint64_t width, std::uint64_t height) {
    constexpr std::uint64_t kLargestSide = std::uint64_t{algo::kMaxLenslets} * algo::kMaxBins;
    if (width > 0 && height > 0 && width <= kLargestSide && height <= kLargestSide) return {};
    return fail(ErrorCode::unsupported,
                name + " is " + std::to_string(width) + "x" + std::to_string(height) + " pixels; a frame has 1 to " +
                    std::to_string(kLargestSide) + " a side",
                "give a frame of the lenslet sensor");
}

// Before a frame of this size is decoded.
common::AcceptSize size_check(const std::string& name, const ExpectedFrame& expected) {
    return [&](std::uint32_t width, std::uint32_t height) -> Result<void> {
        if (auto good = check_size(name, width, height); !good) return good;
        const auto as_declared = [](int wanted, std::uint32_t declared) {
            return wanted > 0 ? wanted : static_cast<int>(declared);
        };
        const int wanted_width = as_declared(expected.width_px, width),
                  wanted_height = as_declared(expected.height_px, height);
        if (std::cmp_equal(width, wanted_width) && std::cmp_equal(height, wanted_height)) return {};
        return fail(ErrorCode::invalid_argument,
                    name + " is " + size_text(static_cast<int>(width), static_cast<int>(height)) +
                        " pixels, expected " + size_text(wanted_width, wanted_height),
                    "give frames of that size");
    };
}

Result<void> check_bits(const std::string& name, const Frame& frame, const ExpectedFrame& expected) {
    // A file with two bytes a sample may have any depth from 9 to 16 bits.
    if (expected.bits != 0 && (expected.bits > 8) != (frame.bits() > 8)) {
        return fail(
            ErrorCode::invalid_argument,
            name + " has " + std::to_string(frame.bits()) + "-bit samples, expected " + std::to_string(expected.bits),
            "say how many bits the samples have (sensor.bits, --bits), or give frames of that depth");
    }
    return {};
}

Result<void> check_range(const std::string& name, const Frame& frame) {
    const FrameView view = frame.view();
    if (view.bits == 8 || view.bits == 16) return {};
    for (int y = 0; y < view.height_px; ++y) {
        const std::uint16_t* row = view.row16(y);
        for (int x = 0; x < view.width_px; ++x) {
            if (row[x] > view.full_scale()) {
                return fail(ErrorCode::invalid_argument,
                            name + " has a sample of " + std::to_string(row[x]) + " at (" + std::to_string(x) + "," +
                                std::to_string(y) + "), more than " + std::to_string(view.bits) + " bits hold",
                            "say how many bits the samples really have (sensor.bits, --bits, or the frame's note), or "
                            "give frames of that depth");
            }
        }
    }
    return {};
}

// "P5", width, height, maximum, each after white space or a comment; then one white space and the samples, big-endian.
Result<Frame> decode_pgm(std::string_view file, const std::string& name, const common::AcceptSize& accept) {
    const auto refuse = [&](const std::string& why) {
        return fail(ErrorCode::unreadable, name + " is " + why, "record or copy it again");
    };
    std::size_t at = 2;
    const auto byte = [&] { return at < file.size() ? file[at] : '\0'; };
    const auto is_space = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    const auto next_number = [&] {  // 0: there is none
        while (is_space(byte()) || byte() == '#')
            at = byte() == '#' ? std::min(file.find('\n', at), file.size()) : at + 1;
        std::uint64_t value = 0;
        for (; byte() >= '0' && byte() <= '9'; ++at)
            value = std::min<std::uint64_t>(value * 10 + static_cast<std::uint64_t>(byte() - '0'), 1U << 30U);
        return value;
    };
    const std::uint64_t width = next_number(), height = next_number(), maximum = next_number();
    if (!is_space(byte()))
        return refuse(at >= file.size() ? "truncated (its header is cut off)" : "damaged (its PGM header has no size)");
    if (maximum == 0 || maximum > 65535) return refuse("damaged (its PGM maximum is not in 1..65535)");
    if (auto good = check_size(name, width, height); !good) return tl::unexpected(good.error());
    if (auto good = common::check_declared_size(name, static_cast<std::uint32_t>(width),
                                                static_cast<std::uint32_t>(height), accept);
        !good)
        return tl::unexpected(good.error());
    const auto samples = file.substr(at + 1);
    const int bits = std::max(8, static_cast<int>(std::bit_width(maximum)));
    const std::uint64_t needed = width * height * (bits > 8 ? 2 : 1);
    if (samples.size() < needed) {
        return refuse("truncated (" + std::to_string(samples.size()) + " of " + std::to_string(needed) +
                      " bytes of samples)");
    }
    Frame frame(static_cast<int>(width), static_cast<int>(height), bits);
    const auto to = frame.bytes();
    const std::size_t swap = bits > 8 ? 1 : 0;
    for (std::size_t k = 0; k < to.size(); ++k) to[k] = std::byte(samples[k ^ swap]);
    return frame;
}

// `note`: receives the text of the PNG chunk, if there is one; null: it is not read.
Result<Frame> decode(std::span<const std::byte> bytes, const std::string& name, const ExpectedFrame& expected,
                     std::optional<std::string>* note = nullptr) {
    using namespace std::string_view_literals;
    constexpr const char* kUseGrey = "save it as 8- or 16-bit grey PNG, TIFF or binary PGM, one channel";
    const std::span file(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const common::AcceptSize accept = size_check(name, expected);
    if (text.empty())
        return fail(ErrorCode::unreadable, name + " is truncated (it is empty)", "record or copy it again");
    if (text.starts_with("\x89PNG\r\n\x1a\n"sv)) {
        auto png = common::decode_grey_png(file, name, note != nullptr ? kKeyword : "", accept);
        if (!png) return tl::unexpected(png.error());
        if (note != nullptr) *note = std::move(png->note);
        return std::move(png->frame);
    }
    if (text.starts_with("II*\0"sv) || text.starts_with("MM\0*"sv)) return common::decode_grey_tiff(file, name, accept);
    if (text.starts_with("P5")) return decode_pgm(text, name, accept);
    if (text.starts_with("P6") || text.starts_with("P3"))
        return fail(ErrorCode::unsupported, name + " is not a grey frame (a colour PPM)", kUseGrey);
    if (text.starts_with("P2"))
        return fail(ErrorCode::unsupported, name + " is a text PGM", "save it as binary PGM (P5)");
    if (text.starts_with("\xFF\xD8\xFF"))
        return fail(ErrorCode::unsupported, name + " is a JPEG, which loses what is measured here", kUseGrey);
    if (auto right = common::require_kind(text, name, common::FileKind::image); !right)
        return fail(ErrorCode::unreadable, right.error().what, right.error().cure);
    return fail(ErrorCode::unreadable, name + " is not a PNG, TIFF or binary PGM image", kUseGrey);
}

// The frame in the expected format.
Result<Frame> checked(Frame&& frame, const std::string& name, const ExpectedFrame& expected) {
    auto good = check_bits(name, frame, expected);
    if (!good) return tl::unexpected(good.error());
    if (expected.bits != 0 && frame.bits() != expected.bits) {
        Frame narrower(frame.width_px(), frame.height_px(), expected.bits);
        std::ranges::copy(frame.bytes(), narrower.bytes().begin());
        frame = std::move(narrower);
    }
    if (good = check_range(name, frame); !good) return tl::unexpected(good.error());
    return std::move(frame);
}

// The geometry in the PNG's text and in the sidecar; none if the file has neither.
Result<std::optional<FrameGeometry>> geometry_of(const fs::path& file, const std::optional<std::string>& note) {
    std::optional<FrameGeometry> geometry;
    if (note) {
        auto parsed = geometry_from_json(*note, file.string());
        if (!parsed) return tl::unexpected(parsed.error());
        geometry = *parsed;
    }
    const fs::path sidecar = sidecar_of(file);
    std::error_code error;
    if (!fs::exists(sidecar, error)) return geometry;
    const auto text = common::read_file(sidecar, common::kMaxText);
    if (!text)
        return fail(ErrorCode::unreadable, sidecar.string() + ", the geometry note of a frame, cannot be read",
                    "check its permissions");
    auto beside = geometry_from_json(*text, sidecar.string());
    if (!beside) return tl::unexpected(beside.error());
    if (geometry && !(*geometry == *beside)) {
        return fail(ErrorCode::unreadable,
                    file.string() + " and " + sidecar.string() + " contradict each other: " + describe(*geometry) +
                        ", and " + describe(*beside),
                    "remove or correct the sidecar");
    }
    return std::optional(*beside);
}

}  // namespace

Result<Frame> decode_frame(std::span<const std::byte> bytes, const std::string& name, const ExpectedFrame& expected) {
    return decode(bytes, name, expected).and_then([&](Frame&& frame) {
        return checked(std::move(frame), name, expected);
    });
}

fs::path sidecar_of(const fs::path& file) { return fs::path(file).replace_extension(".frame.json"); }

Result<NotedFrame> read_noted_frame(const fs::path& file, const ExpectedFrame& expected) {
    const auto bytes = read_bytes(file);
    if (!bytes) return tl::unexpected(bytes.error());
    std::optional<std::string> note;
    auto frame = decode(*bytes, file.string(), expected, &note);
    if (!frame) return tl::unexpected(frame.error());
    const auto geometry = geometry_of(file, note);
    if (!geometry) return tl::unexpected(geometry.error());
    ExpectedFrame format = expected;
    if (*geometry) {
        if (auto fine = check_against(**geometry, *frame, file.string()); !fine) return tl::unexpected(fine.error());
        format.bits = (*geometry)->bits;
    }
    auto whole = checked(std::move(*frame), file.string(), format);
    if (!whole) return tl::unexpected(whole.error());
    return NotedFrame{std::move(*whole), *geometry};
}

Result<Frame> read_frame(const fs::path& file, const ExpectedFrame& expected) {
    const auto bytes = read_bytes(file);
    if (!bytes) return tl::unexpected(bytes.error());
    return decode_frame(*bytes, file.string(), expected);
}

Result<void> write_frame(const fs::path& file, const FrameView& frame, const std::optional<FrameGeometry>& geometry) {
    if (frame.data == nullptr || frame.width_px <= 0 || frame.height_px <= 0) {
        return fail(ErrorCode::invalid_argument, "the frame for " + file.string() + " is empty");
    }
    std::optional<common::PngNote> note;
    if (geometry) note = common::PngNote{kKeyword, to_json(*geometry)};
    const auto png = common::encode_grey_png(frame, {}, note);
    if (!png) return tl::unexpected(png.error());
    return common::write_atomically(file, *png);
}

Result<std::vector<fs::path>> list_frames(const std::vector<fs::path>& files_or_folders) {
    std::vector<fs::path> out;
    for (const fs::path& path : files_or_folders) {
        std::error_code error;
        if (!fs::exists(path, error))
            return fail(ErrorCode::not_found, path.string() + " is not there", "check the name");
        if (!fs::is_directory(path, error)) {
            out.push_back(path);
            continue;
        }
        std::vector<fs::path> in_folder;
        for (auto entry = fs::directory_iterator(path, error); !error && entry != fs::directory_iterator();
             entry.increment(error)) {
            if (looks_like_a_frame(entry->path())) in_folder.push_back(entry->path());
        }
        if (error)
            return fail(ErrorCode::unreadable, "the folder " + path.string() + " cannot be read",
                        "check its permissions");
        if (in_folder.empty()) {
            return fail(ErrorCode::not_found, "the folder " + path.string() + " holds no frame",
                        "put PNG, TIFF or PGM frames into it");
        }
        std::ranges::sort(in_folder);
        out.insert(out.end(), in_folder.begin(), in_folder.end());
    }
    if (out.empty()) return fail(ErrorCode::not_found, "no recorded frame is named", "name a folder or files");
    return out;
}

}  // namespace hord::drivers
