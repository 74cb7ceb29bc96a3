#include "firmware/diagnostics/map_files.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/tiff_codec.h"

namespace hord::firmware {
namespace {

struct MaskReason {
    algo::MaskBit bit;
    const char* name;
    common::PngColour colour;
};
// The first that applies gives the colour of a mask value.
constexpr MaskReason kMaskReasons[] = {
    {algo::kSaturated, "saturated", {255, 255, 255}},
    {algo::kDark, "dark", {0, 0, 0}},
    {algo::kBorder, "border", {128, 128, 128}},
    {algo::kOutside, "outside", {60, 90, 160}},
    {algo::kRim, "rim", {130, 180, 230}},
    {algo::kAtLimit, "at-limit", {240, 160, 30}},
};
constexpr common::PngColour kJudgedColour{40, 130, 60};
constexpr unsigned kMaskValues = 64;

std::string hex(const common::PngColour& c) { return fmt::format("#{:02x}{:02x}{:02x}", c.red, c.green, c.blue); }

}  // namespace

Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents) {
    return common::encode_float_tiff(extents.m, extents.n, map).and_then([&](const auto& bytes) {
        return common::write_atomically(file, bytes);
    });
}

Result<void> write_float_tiff(const std::filesystem::path& file, const FeatureView& view,
                              const algo::Extents& extents) {
    return write_float_tiff(file, with_no_data(view.map, view.mask, view.no_value), extents);
}

Result<void> write_mask_png(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents) {
    std::vector<common::PngColour> palette(kMaskValues, kJudgedColour);
    for (unsigned value = 0; value < kMaskValues; ++value) {
        const auto* reason =
            std::ranges::find_if(kMaskReasons, [&](const MaskReason& r) { return (value & r.bit) != 0; });
        if (reason != std::end(kMaskReasons)) palette[value] = reason->colour;
    }
    nlohmann::ordered_json legend{{"schema", 1}, {"feature", view.name}};
    for (const MaskReason& reason : kMaskReasons) {
        legend["bits"][reason.name] = static_cast<int>(reason.bit);
        legend["colours"][reason.name] = hex(reason.colour);
    }
    legend["colours"]["judged"] = hex(kJudgedColour);
    legend["no_value"] = static_cast<int>(view.no_value);
    legend["not_judged"] = static_cast<int>(view.not_judged);
    return common::encode_index_png(extents.m, extents.n, view.mask, palette,
                                    common::PngNote{"hord-mask", legend.dump()})
        .and_then([&](const auto& bytes) { return common::write_atomically(file, bytes); });
}

}  // namespace hord::firmware
