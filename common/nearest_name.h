// "Did you mean ...?": the name most similar to a misspelt one.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace hord::common {

// Levenshtein distance.
inline std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t k = 0; k < row.size(); ++k) row[k] = k;
    for (std::size_t y = 1; y <= a.size(); ++y) {
        std::size_t diagonal = row[0];
        row[0] = y;
        for (std::size_t x = 1; x <= b.size(); ++x) {
            const std::size_t above = row[x];
            row[x] = std::min({above + 1, row[x - 1] + 1, diagonal + (a[y - 1] == b[x - 1] ? 0U : 1U)});
            diagonal = above;
        }
    }
    return row[b.size()];
}

// None: no name of `names` is similar.
template <class Names>
std::optional<std::string> nearest_name(std::string_view misspelt, const Names& names) {
    const auto nearest = std::min_element(names.begin(), names.end(), [&](const auto& a, const auto& b) {
        return edit_distance(a, misspelt) < edit_distance(b, misspelt);
    });
    if (nearest == names.end() || edit_distance(*nearest, misspelt) > std::max<std::size_t>(2, misspelt.size() / 3))
        return std::nullopt;
    return std::string(*nearest);
}

}  // namespace hord::common
