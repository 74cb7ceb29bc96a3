// Lists of an enumeration's values, derived from its name_of().
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

namespace hord::firmware {

// The values of E below 64 that have a name (name_of() is not "unknown"), ascending.
template <class E>
inline constexpr auto kValuesOf = [] {
    constexpr int kEnd = 64;
    constexpr auto named = [](int value) { return name_of(static_cast<E>(value)) != std::string_view("unknown"); };
    constexpr std::size_t count = [=] {
        std::size_t n = 0;
        for (int value = 0; value < kEnd; ++value) n += named(value) ? 1U : 0U;
        return n;
    }();
    std::array<E, count> values{};
    std::size_t n = 0;
    for (int value = 0; value < kEnd; ++value) {
        if (named(value)) values[n++] = static_cast<E>(value);
    }
    return values;
}();

}  // namespace hord::firmware
