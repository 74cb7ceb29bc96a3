// How much of a name registers hold.
#pragma once

#include <cstddef>

namespace hord::common {

// Bytes of UTF-8, of the name of a station or of a recipe; of a longer name the first ones.
inline constexpr std::size_t kNameBytes = 32;

}  // namespace hord::common
