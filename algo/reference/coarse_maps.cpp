#include "algo/reference/coarse_maps.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// The sums of one block.
struct Block {
    double light = 0, with_hord = 0, x = 0, y = 0;
    int hords = 0;
    std::uint8_t mask = 0;

    void add(double of_light, double of_x, double of_y, std::uint8_t of_mask) {
        light += of_light;
        mask |= static_cast<std::uint8_t>(of_mask & ~kDark);
        if ((of_mask & kNoHord) != 0) return;
        ++hords;
        with_hord += of_light, x += of_light * of_x, y += of_light * of_y;
    }
    [[nodiscard]] bool has_hord() const {
        return 2 * hords >= CoarseMaps::kBlock * CoarseMaps::kBlock && with_hord > 0;
    }
    [[nodiscard]] std::uint8_t whole_mask() const {
        return static_cast<std::uint8_t>(mask | (has_hord() ? kValid : kDark));
    }
    [[nodiscard]] double mean(double moment) const { return has_hord() ? moment / with_hord : 0; }
};

}  // namespace

CoarseMaps::CoarseMaps(const Extents& fine)
    : fine_(fine), extents_{fine.m / kBlock, fine.n / kBlock, fine.i, fine.j}, light_(extents_.lenslets()),
      x_(light_.size()), y_(light_.size()), sums_(light_.size()), deflections_(light_.size()),
      reference_mask_(light_.size()), part_mask_(light_.size()) {}

void CoarseMaps::fill(const ReferenceMaps& reference, const PartMaps& part) {
    const int first_m = (fine_.m - kBlock * extents_.m) / 2, first_n = (fine_.n - kBlock * extents_.n) / 2;
    const auto bins = [](double value) {
        return DeflectionQ::from_raw(static_cast<std::int32_t>(std::lround(value * 0x1p24)));
    };
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m) {
            Block of_reference, of_part;
            for (int t = 0; t < kBlock * kBlock; ++t) {
                const std::size_t k = fine_.index(first_m + kBlock * m + t % kBlock, first_n + kBlock * n + t / kBlock);
                of_reference.add(static_cast<double>(reference.light[k]), static_cast<double>(reference.x[k]),
                                 static_cast<double>(reference.y[k]), reference.mask[k]);
                of_part.add(static_cast<double>(part.sums[k]), part.deflections[k].x.to_double_rounded(),
                            part.deflections[k].y.to_double_rounded(), part.mask[k]);
            }
            const std::size_t k = extents_.index(m, n);
            light_[k] = static_cast<float>(of_reference.light);
            x_[k] = static_cast<float>(of_reference.mean(of_reference.x));
            y_[k] = static_cast<float>(of_reference.mean(of_reference.y));
            reference_mask_[k] = of_reference.whole_mask();
            sums_[k] = static_cast<std::uint32_t>(std::min(of_part.light, 4e9));
            deflections_[k] = {bins(of_part.mean(of_part.x)), bins(of_part.mean(of_part.y))};
            part_mask_[k] = of_part.whole_mask();
        }
    }
}

}  // namespace hord::algo
