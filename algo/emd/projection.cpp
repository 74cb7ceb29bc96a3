#include "algo/emd/projection.h"

#include <algorithm>
#include <cmath>

#include "common/fixed.h"

namespace hord::algo {

Projection::Projection(std::span<const Direction> directions, double x, double y) : place_of_bin_(directions.size()) {
    std::vector<double> at(directions.size());
    std::vector<double> places;
    for (std::size_t k = 0; k < directions.size(); ++k) {
        at[k] = directions[k].x * x + directions[k].y * y;
        places.push_back(at[k]);
    }
    std::sort(places.begin(), places.end());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    for (std::size_t k = 0; k < at.size(); ++k) {
        place_of_bin_[k] =
            static_cast<std::uint8_t>(std::lower_bound(places.begin(), places.end(), at[k]) - places.begin());
    }
    for (std::size_t p = 0; p + 1 < places.size(); ++p) gap_.push_back(places[p + 1] - places[p]);
}

double Projection::distance(const Difference& d) const {
    std::array<double, kMaxBinCount> mass;
    std::fill_n(mass.begin(), gap_.size() + 1, 0.0);
    for (std::size_t k = 0; k < static_cast<std::size_t>(d.count); ++k) mass[place_of_bin_[d.bin[k]]] += d.mass[k];
    double sum = 0;
    double passed = 0;
    for (std::size_t p = 0; p < gap_.size(); ++p) {
        passed += mass[p];
        expect_no_overflow(std::abs(passed) < 0x1p49);
        sum += std::abs(passed) * gap_[p];
    }
    return sum;
}

}  // namespace hord::algo
