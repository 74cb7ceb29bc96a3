#include "drivers/files/frame_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/tiff_codec.h"
#include "drivers/files/frame_header.h"

namespace hord::drivers {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::byte>;

bool looks_like_a_frame(const fs::path& file) {
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
        return fail(ErrorCode::not_found, file.string() + " does not exist", "check the path");
    }
    if (status.type() == fs::file_type::directory) {
        return fail(ErrorCode::unreadable, file.string() + " is a folder", "name the frames in it");
    }
    if (status.type() != fs::file_type::regular) {
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

Result<void> check_expected(const std::string& name, const FrameHeader& header, const ExpectedFrame& expected) {
    const int width = expected.width_px > 0 ? expected.width_px : header.width_px;
    const int height = expected.height_px > 0 ? expected.height_px : header.height_px;
    if (header.width_px != width || header.height_px != height) {
        return fail(ErrorCode::invalid_argument,
                    name + " is " + size_text(header.width_px, header.height_px) + " pixels, expected " +
                        size_text(width, height),
                    "give frames of the configured sensor, or correct the configured size");
    }
    // A file with two bytes a sample may have any depth from 9 to 16 bits.
    if (expected.bits != 0 && (expected.bits > 8) != (header.bits > 8)) {
        return fail(
            ErrorCode::invalid_argument,
            name + " has " + std::to_string(header.bits) + "-bit samples, expected " + std::to_string(expected.bits),
            "correct the configured bits, or record the frame again");
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
                            "say how many bits the samples really have");
            }
        }
    }
    return {};
}

void copy_pgm(std::span<const std::byte> bytes, const FrameHeader& header, Frame& frame) {
    const auto to = frame.bytes();
    const std::byte* from = bytes.data() + header.samples_at;
    if (header.bits <= 8) {
        std::memcpy(to.data(), from, to.size());
    } else {  // PGM is big-endian
        for (std::size_t k = 0; k + 1 < to.size(); k += 2) {
            to[k] = from[k + 1];
            to[k + 1] = from[k];
        }
    }
}

Result<Frame> decode(std::span<const std::byte> bytes, const FrameHeader& header, const std::string& name) {
    const std::span packed(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
    Result<Frame> frame;
    if (header.format == FrameHeader::Format::tiff) {
        frame = common::decode_grey_tiff(packed, name);
    } else {
        frame = common::decode_grey_png(packed, name).map([](common::GreyPng&& png) { return std::move(png.frame); });
    }
    if (frame &&
        (frame->width_px() != header.width_px || frame->height_px() != header.height_px ||
         frame->bits() != header.bits)) {
        return fail(ErrorCode::unreadable, name + " is damaged (its samples are not what its header says)",
                    "record or copy it again");
    }
    return frame;
}

}  // namespace

Result<Frame> decode_frame(std::span<const std::byte> bytes, const std::string& name, const ExpectedFrame& expected) {
    const auto header = read_frame_header(bytes, name);
    if (!header) return tl::unexpected(header.error());
    if (auto good = check_expected(name, *header, expected); !good) return tl::unexpected(good.error());
    const int bits = expected.bits != 0 ? expected.bits : header->bits;
    Frame frame;
    if (header->format == FrameHeader::Format::pgm) {
        frame = Frame(header->width_px, header->height_px, bits);
        copy_pgm(bytes, *header, frame);
    } else {
        auto decoded = decode(bytes, *header, name);
        if (!decoded) return tl::unexpected(decoded.error());
        frame = std::move(*decoded);
        if (frame.bits() != bits) {
            Frame narrower(frame.width_px(), frame.height_px(), bits);
            std::ranges::copy(frame.bytes(), narrower.bytes().begin());
            frame = std::move(narrower);
        }
    }
    if (auto good = check_range(name, frame); !good) return tl::unexpected(good.error());
    return frame;
}

Result<Frame> read_frame(const fs::path& file, const ExpectedFrame& expected) {
    const auto bytes = read_bytes(file);
    if (!bytes) return tl::unexpected(bytes.error());
    return decode_frame(*bytes, file.string(), expected);
}

Result<void> write_frame(const fs::path& file, const FrameView& frame) {
    if (frame.data == nullptr || frame.width_px <= 0 || frame.height_px <= 0) {
        return fail(ErrorCode::invalid_argument, "the frame for " + file.string() + " is empty");
    }
    const auto png = common::encode_grey_png(frame);
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
