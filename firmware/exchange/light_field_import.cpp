#include "firmware/exchange/light_field_import.h"

#include <cerrno>
#include <charconv>
#include <cstring>
#include <map>
#include <optional>

#include <fmt/format.h>

#include "algo/frame/extents.h"
#include "common/file_writing.h"
#include "drivers/files/frame_file.h"
#include "firmware/exchange/array.h"
#include "firmware/exchange/hdf5_file.h"
#include "firmware/exchange/lytro.h"
#include "firmware/exchange/viewpoint_file.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

std::uint32_t element(const Array& array, std::size_t k) {
    if (array.type == ArrayType::uint8) return std::to_integer<std::uint32_t>(array.bytes[k]);
    std::uint16_t value = 0;
    std::memcpy(&value, array.bytes.data() + 2 * k, sizeof value);
    return value;
}

Result<algo::Extents> extents_of(std::size_t n, std::size_t m, std::size_t j, std::size_t i, const std::string& name) {
    constexpr std::size_t kLarge = 100'000;
    if (std::max({n, m, j, i}) > kLarge)
        return fail(ErrorCode::invalid_argument, fmt::format("{}: {}x{} lenslets of {}x{} bins", name, m, n, i, j),
                    "give samples [n, m, j, i]");
    const algo::Extents e{static_cast<int>(m), static_cast<int>(n), static_cast<int>(i), static_cast<int>(j)};
    if (auto fine = algo::check(e); !fine)
        return fail(fine.error().code, name + ": " + fine.error().what, fine.error().cure);
    return e;
}

// A frame whose sample (m, n, i, j) is sample(m, n, i, j).
template <class Sample>
Imported frame_of(const algo::Extents& e, int bits, std::string from, Sample&& sample) {
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int n = 0; n < e.n; ++n) {
        for (int j = 0; j < e.j; ++j) {
            for (int m = 0; m < e.m; ++m) {
                for (int i = 0; i < e.i; ++i) frame.set(m * e.i + i, n * e.j + j, sample(m, n, i, j));
            }
        }
    }
    return {std::move(frame), {drivers::FrameKind::macro_pixels, e, bits}, std::move(from)};
}

int bits_of(const Array& array) { return array.type == ArrayType::uint8 ? 8 : 16; }

// [n, m, j, i], as hordctl export and `hord` write it.
Result<Imported> from_own_order(const Array& array, const std::string& name, std::string from) {
    const auto& s = array.shape;
    if (s.size() != 4) {
        return fail(ErrorCode::unsupported, fmt::format("{} has {} dimensions", name, s.size()),
                    "give samples [n, m, j, i]");
    }
    const auto e = extents_of(s[0], s[1], s[2], s[3], name);
    if (!e) return tl::unexpected(e.error());
    return frame_of(*e, bits_of(array), std::move(from), [&](int m, int n, int i, int j) {
        const auto at = [](int k) { return static_cast<std::size_t>(k); };
        return element(array, ((at(n) * s[1] + at(m)) * s[2] + at(j)) * s[3] + at(i));
    });
}

// LF(j, i, l, k, c) of MATLAB: its files have the dimensions in reverse, [c, k, l, i, j]; k is along m, l along n.
Result<Imported> from_lf_toolbox(const Array& array, const std::string& name) {
    std::vector<std::size_t> s = array.shape;
    if (s.size() == 4) s.insert(s.begin(), 1);
    if (s.size() != 5 || (s[0] != 1 && s[0] != 3 && s[0] != 4)) {
        return fail(ErrorCode::unsupported, fmt::format("{}: LF has {} dimensions", name, array.shape.size()),
                    "LFToolbox writes LF(j, i, l, k, c) with 1, 3 or 4 channels");
    }
    const auto e = extents_of(s[2], s[1], s[4], s[3], name);
    if (!e) return tl::unexpected(e.error());
    const std::size_t channel = s[1] * s[2] * s[3] * s[4];
    const bool colour = s[0] > 1;
    return frame_of(*e, bits_of(array), colour ? "LFToolbox, the mean of red, green and blue" : "LFToolbox",
                    [&](int m, int n, int i, int j) {
                        const auto at = [](int k) { return static_cast<std::size_t>(k); };
                        const std::size_t k = ((at(m) * s[2] + at(n)) * s[3] + at(i)) * s[4] + at(j);
                        if (!colour) return element(array, k);
                        return (element(array, k) + element(array, channel + k) + element(array, 2 * channel + k) + 1) /
                            3;
                    });
}

// "J_I" of a viewpoint's file.
std::optional<std::pair<int, int>> place_of(const std::string& stem) {
    int j = 0, i = 0;
    const char* const end = stem.data() + stem.size();
    const auto first = std::from_chars(stem.data(), end, j);
    if (first.ec != std::errc{} || first.ptr == end || *first.ptr != '_') return std::nullopt;
    const auto second = std::from_chars(first.ptr + 1, end, i);
    if (second.ec != std::errc{} || second.ptr != end || i < 0 || j < 0) return std::nullopt;
    return std::pair(j, i);
}

// A folder of images J_I.png or J_I.tiff, each a pixel a lenslet.
Result<Imported> from_viewpoints(const fs::path& folder) {
    const std::string name = folder.string();
    const auto files = drivers::list_frames({folder});
    if (!files && files.error().code == ErrorCode::not_found && fs::is_directory(folder)) {
        return fail(ErrorCode::not_found, name + " holds no viewpoint",
                    "give the folder of PlenoptiCam's viewpoints: images named J_I.tiff or J_I.png");
    }
    if (!files) return tl::unexpected(files.error());
    std::map<std::pair<int, int>, Frame> views;
    int rows = 0, columns = 0;
    bool colour = false;
    for (const fs::path& file : *files) {
        const auto place = place_of(file.stem().string());
        if (!place) continue;
        if (place->first >= algo::kMaxBins || place->second >= algo::kMaxBins) {
            return fail(ErrorCode::invalid_argument, file.string() + " is beyond 15 x 15 viewpoints",
                        "give 3 to 15 viewpoints along each axis");
        }
        auto view = read_viewpoint(file);
        if (!view) {
            Error error = view.error();
            if (error.code == ErrorCode::unsupported)
                error.cure = "save the viewpoints as grey images, or as TIFF of red, green and blue";
            return tl::unexpected(error);
        }
        Frame* const frame = &view->frame;
        colour = colour || view->colour;
        rows = std::max(rows, place->first + 1), columns = std::max(columns, place->second + 1);
        const Frame& like = views.empty() ? *frame : views.begin()->second;
        if (frame->width_px() != like.width_px() || frame->height_px() != like.height_px() ||
            frame->bits() != like.bits()) {
            return fail(ErrorCode::invalid_argument, file.string() + " is not of the size and depth of the others",
                        "give the viewpoints of one light field");
        }
        if (!views.emplace(*place, std::move(*frame)).second) {
            return fail(ErrorCode::invalid_argument, file.string() + " is there in two formats",
                        "leave one of them in the folder");
        }
    }
    if (views.empty() || views.size() != static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns)) {
        return fail(ErrorCode::not_found,
                    fmt::format("{} has {} of {} viewpoints J_I.png or J_I.tiff", name, views.size(), rows * columns),
                    "give PlenoptiCam's folder viewpoints_NNpx, complete");
    }
    const Frame& like = views.begin()->second;
    const auto e = extents_of(static_cast<std::size_t>(like.height_px()), static_cast<std::size_t>(like.width_px()),
                              static_cast<std::size_t>(rows), static_cast<std::size_t>(columns), name);
    if (!e) return tl::unexpected(e.error());
    return frame_of(*e, like.bits(),
                    colour ? "PlenoptiCam's viewpoints, the mean of red, green and blue" : "PlenoptiCam's viewpoints",
                    [&](int m, int n, int i, int j) {
                        return views.at({j, i}).view().sample(m, n);
                    });
}

}  // namespace

Result<Imported> import_light_field(const fs::path& path) {
    const std::string name = path.string();
    std::error_code error;
    if (fs::is_directory(path, error)) return from_viewpoints(path);
    const auto text = common::read_file(path);
    if (!text) {
        return fail(ErrorCode::not_found, fmt::format("{} cannot be read ({})", name, std::strerror(errno)),
                    "check the path");
    }
    const std::string_view head(*text);
    const std::span<const std::byte> bytes(reinterpret_cast<const std::byte*>(text->data()), text->size());
    if (is_lytro(bytes)) {
        auto frame = decode_lytro(bytes, name);
        if (!frame) return tl::unexpected(frame.error());
        const int bits = frame->bits();
        return Imported{std::move(*frame), {drivers::FrameKind::raw, {}, bits}, "Lytro's raw frame"};
    }
    if (head.starts_with("\x93NUMPY")) {
        return decode_npy(bytes, name).and_then([&](const Array& array) {
            return from_own_order(array, name, "NumPy");
        });
    }
    if (head.starts_with("MATLAB 5.0")) {
        return fail(ErrorCode::unsupported, name + " is a MATLAB file of version 5 to 7",
                    "save it again in MATLAB with save(..., '-v7.3')");
    }
    if (head.starts_with("MATLAB 7.3")) {
        return read_hdf5(path, "LF").and_then([&](const Array& array) { return from_lf_toolbox(array, name); });
    }
    if (head.starts_with("\x89HDF\r\n\x1a\n")) {
        return read_hdf5(path, "light_field").and_then([&](const Array& array) {
            return from_own_order(array, name, "HDF5");
        });
    }
    return fail(ErrorCode::unsupported, name + " is no light field that is known",
                "known are .npy and HDF5 of hordctl export, LFToolbox's .mat of version 7.3, a folder of PlenoptiCam's "
                "viewpoints, and Lytro's .lfp and .lfr");
}

}  // namespace hord::firmware
