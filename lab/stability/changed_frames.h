// Frames as the fuzz target `verdict` draws them (tests/fuzz/verdict_fuzz.cpp): a clean frame after changes that bytes
// choose. An input is a recipe's byte, then changes of five bytes each: kind, x, y, width or amount, height or seed.
#pragma once

#include <cstdint>
#include <span>

#include "algo/frame/extents.h"
#include "algo/recipe/recipe.h"
#include "common/frame.h"

namespace hord::lab {

// A lens in free light, 8 bits, without noise.
Frame clean_frame(const algo::Extents& extents);

// `clean`, a frame of 9x9 bins and 8 bits, after the input's first eight changes, one after the other.
Frame changed_frame(const Frame& clean, std::span<const std::uint8_t> input);

// The recipe of an input's first byte.
algo::Recipe recipe_of_byte(unsigned byte);

}  // namespace hord::lab
