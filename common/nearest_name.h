// "Did you mean ...?": the name most similar to a misspelt one.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace hord::common {

// Insertions, deletions, replacements and swaps of neighbours (optimal string alignment).
inline std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
    for (std::size_t k = 0; k < above.size(); ++k) above[k] = k;
    for (std::size_t y = 1; y <= a.size(); ++y) {
        row[0] = y;
        for (std::size_t x = 1; x <= b.size(); ++x) {
            row[x] = std::min({above[x] + 1, row[x - 1] + 1, above[x - 1] + (a[y - 1] == b[x - 1] ? 0U : 1U)});
            if (y > 1 && x > 1 && a[y - 1] == b[x - 2] && a[y - 2] == b[x - 1])
                row[x] = std::min(row[x], before[x - 2] + 1);
        }
        before.swap(above);
        above.swap(row);
    }
    return above[b.size()];
}

// The first of the nearest names. None: no name of `names` is similar. One edit for every three letters is allowed, and
// one at least; hyphens in front do not count.
template <class Names>
std::optional<std::string> nearest_name(std::string_view misspelt, const Names& names) {
    const std::size_t letters = misspelt.size() - std::min(misspelt.find_first_not_of('-'), misspelt.size());
    std::size_t limit = std::max<std::size_t>(1, letters / 3) + 1;  // a nearer name has fewer edits
    std::optional<std::string> nearest;
    for (const std::string_view name : names) {
        const std::size_t fewest = std::max(name.size(), misspelt.size()) - std::min(name.size(), misspelt.size());
        if (fewest >= limit) continue;  // each letter that one has more is an edit
        const std::size_t edits = edit_distance(name, misspelt);
        if (edits >= limit) continue;
        limit = edits;
        nearest = name;
    }
    return nearest;
}

}  // namespace hord::common
