// Maps as files for other programs: values as float TIFF, the reasons of missing values as mask PNG.
#pragma once

#include <filesystem>

#include "algo/frame/extents.h"
#include "algo/frame/mask.h"
#include "common/result.h"
#include "firmware/diagnostics/feature_views.h"

namespace hord::firmware {

// The file appears whole or not at all. Fail with not_found (the folder) and io, naming the file and the cure; with
// invalid_argument (a map of another size), internal.
Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents);

// The view as float TIFF: NaN where a lenslet has no value.
Result<void> write_float_tiff(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents);

// Why lenslets have no value or are not judged: an 8-bit palette PNG, a pixel a lenslet, whose index is the mask value
// (algo/frame/mask.h). Its iTXt chunk "hord-mask" names feature, bits, colours, and the bits without a value, in JSON.
Result<void> write_mask_png(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents);

}  // namespace hord::firmware
