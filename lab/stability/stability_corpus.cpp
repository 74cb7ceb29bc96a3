// The time of verdicts on the inputs that the fuzz targets begin with: changed frames, and frame files of all formats.
#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/tiff_codec.h"
#include "drivers/files/frame_file.h"
#include "lab/stability/changed_frames.h"
#include "lab/stability/stability.h"
#include "lab/stability/verdict_series.h"

namespace hord::lab {
namespace {

struct Input {
    std::string name;
    std::vector<std::uint8_t> bytes;
};

// Sorted by name. Fails with not_found, unreadable.
Result<std::vector<Input>> read_inputs(const std::filesystem::path& folder) {
    std::vector<Input> inputs;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        const auto text = common::read_file(entry.path());
        if (!text) return tl::unexpected(common::cannot_read(entry.path()));
        inputs.push_back({entry.path().filename().string(), {text->begin(), text->end()}});
    }
    if (inputs.empty())
        return tl::unexpected(Error{ErrorCode::not_found, folder.string() + " has no inputs of a fuzz target",
                                    "give the folder of the fuzz corpus, such as tests/fuzz/corpus"});
    std::ranges::sort(inputs, {}, &Input::name);
    return inputs;
}

// As tests/fuzz/frame_file_fuzz.cpp reads it.
Result<Frame> decoded(const Input& input) {
    const std::uint8_t kind = input.bytes.empty() ? 0 : input.bytes[0];
    const std::span file = std::span(input.bytes).subspan(std::min<std::size_t>(input.bytes.size(), 1));
    if (kind % 3 == 0) return drivers::decode_frame(std::as_bytes(file), input.name, {.bits = kind >= 128 ? 12 : 0});
    if (kind % 3 == 1) return common::decode_grey_tiff(file, input.name);
    return common::decode_grey_png(file, input.name, "hord").map([](common::GreyPng&& png) {
        return std::move(png.frame);
    });
}

// With samples of as many bits.
Frame with_bits(const Frame& eight, int bits) {
    Frame frame(eight.width_px(), eight.height_px(), bits);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x)
            frame.set(x, y, eight.view().sample(x, y) << static_cast<unsigned>(bits - 8));
    }
    return frame;
}

// Whole macro-pixels of 3x3 samples, from the left top corner on.
Frame cut(const Frame& from, const algo::Extents& e) {
    Frame frame(e.width_px(), e.height_px(), from.bits());
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) frame.set(x, y, from.view().sample(x, y));
    }
    return frame;
}

}  // namespace

Result<void> add_changed_frames(const std::filesystem::path& folder, int lenslets, VerdictTimes& times) {
    const auto inputs = read_inputs(folder);
    if (!inputs) return tl::unexpected(inputs.error());
    const algo::Extents e{lenslets, lenslets, 9, 9};
    const Frame clean = clean_frame(e);
    auto series = VerdictSeries::of(e, {}, clean, "fuzz corpus, default recipe");
    if (!series) return tl::unexpected(series.error());
    for (const Input& input : *inputs) {
        const Frame frame = changed_frame(clean, input.bytes);
        if (auto done = series->add(frame, input.name, times); !done) return done;
        // By its own recipe, too.
        const unsigned recipe = input.bytes.empty() ? 0 : input.bytes[0];
        auto own = VerdictSeries::of(e, recipe_of_byte(recipe), clean, fmt::format("fuzz corpus, recipe {}", recipe));
        if (!own) return tl::unexpected(own.error());
        if (auto done = own->add(frame, input.name, times); !done) return done;
        times.sizes.rows.push_back(own->summary());
    }
    times.sizes.rows.push_back(series->summary());
    return {};
}

Result<void> add_frame_files(const std::filesystem::path& folder, VerdictTimes& times) {
    const auto inputs = read_inputs(folder);
    if (!inputs) return tl::unexpected(inputs.error());
    for (const Input& input : *inputs) {
        const auto frame = decoded(input);
        if (!frame) return tl::unexpected(frame.error());
        const algo::Extents e{frame->width_px() / 3, frame->height_px() / 3, 3, 3};
        if (std::min(e.m, e.n) < 3) {
            times.frames.rows.push_back({fmt::format("{}x{} px", frame->width_px(), frame->height_px()), "frame file",
                                         input.name, "-", "no light field", "no"});
            continue;
        }
        auto series = VerdictSeries::of(e, {}, with_bits(clean_frame(e), frame->bits()), "frame file");
        if (!series) return tl::unexpected(series.error());
        if (auto done = series->add(cut(*frame, e), input.name, times); !done) return done;
        times.sizes.rows.push_back(series->summary());
    }
    return {};
}

}  // namespace hord::lab
