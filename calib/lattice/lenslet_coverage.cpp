#include "calib/lattice/lenslet_coverage.h"

#include <algorithm>

namespace hord::calib {
namespace {

using algo::PixelPoint;

constexpr double kDark = 0.25;  // of the light of a typical lenslet

// State of each lenslet of the grid, row by row.
struct Places {
    const algo::LensletGrid& grid;
    std::vector<std::uint8_t> inside, dark;

    explicit Places(const algo::LensletGrid& of) : grid(of), inside(of.index(0, of.rows)), dark(inside) {}

    // True if `test` holds for all (with `any`: for one) of the 3x3 lenslets around (m, n) that are inside the frame.
    template <class Test>
    [[nodiscard]] bool about(int m, int n, bool any, Test test) const {
        for (int row = std::max(0, n - 1); row <= std::min(grid.rows - 1, n + 1); ++row) {
            for (int column = std::max(0, m - 1); column <= std::min(grid.columns - 1, m + 1); ++column) {
                const std::size_t k = grid.index(column, row);
                if (inside[k] != 0 && test(k) == any) return any;
            }
        }
        return !any;
    }
};

}  // namespace

std::vector<std::uint8_t> lenslet_coverage(const algo::LensletGrid& grid, std::span<const Observation> observations,
                                           const std::function<bool(int m, int n)>& complete, const LensletLight& light,
                                           double typical_dn) {
    Places places(grid);
    std::vector<std::uint8_t> found(places.inside.size()), whole(found);
    for (const Observation& seen : observations) {
        if (grid.contains(seen.m, seen.n)) found[grid.index(seen.m, seen.n)] = 1;
    }
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const PixelPoint at = grid.centre_px(m, n);
            if (!grid.in_frame(at)) continue;
            const std::size_t k = grid.index(m, n);
            places.inside[k] = 1;
            whole[k] = complete(m, n) ? 1 : 0;
            places.dark[k] = found[k] == 0 && light(at) < kDark * typical_dn ? 1 : 0;
        }
    }
    // The core of dark regions; the dark lenslets that touch it; then their edge is cleared.
    std::vector<std::uint8_t> core(places.inside.size()), region(core);
    const auto each_place = [&](auto&& action) {
        for (int n = 0; n < grid.rows; ++n) {
            for (int m = 0; m < grid.columns; ++m) {
                if (places.inside[grid.index(m, n)] != 0) action(m, n, grid.index(m, n));
            }
        }
    };
    each_place([&](int m, int n, std::size_t k) {
        core[k] = places.about(m, n, false, [&](std::size_t other) { return places.dark[other] != 0; }) ? 1 : 0;
    });
    each_place([&](int m, int n, std::size_t k) {
        region[k] = places.dark[k] != 0 && places.about(m, n, true, [&](std::size_t other) { return core[other] != 0; })
            ? 1
            : 0;
    });
    each_place([&](int m, int n, std::size_t k) {
        if (places.about(m, n, true, [&](std::size_t other) { return region[other] != 0; })) whole[k] = 0;
    });
    return whole;
}

}  // namespace hord::calib
