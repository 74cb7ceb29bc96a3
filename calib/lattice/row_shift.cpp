#include "calib/lattice/row_shift.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace hord::calib {
namespace {

constexpr int kMinRows = 16, kMaxPairs = 256;

}  // namespace

RowShift row_shift(const WhiteImage& image) {
    const int width = image.width_px(), height = image.height_px();
    if (height < kMinRows) return {};
    const int places = height - 3, pairs = std::min(places, kMaxPairs);
    const auto row_floats = static_cast<std::size_t>(width);
    std::vector<float> rows(4 * row_floats);
    struct Pair {
        double product = 0, square = 0;
    };
    std::vector<Pair> all;
    double product = 0, square = 0;
    for (int k = 0; k < pairs; ++k) {
        // At distances without a period, because the lenslets have one.
        double whole = 0;
        const int y = pairs == places
            ? k
            : static_cast<int>(std::modf(k * (std::numbers::phi - 1), &whole) * places);  // the row above the pair
        image.window(0, y, width, 4, rows.data(), width);
        Pair pair;
        for (int row = 1; row <= 2; ++row) {
            const float *here = rows.data() + static_cast<std::ptrdiff_t>(row) * width, *above = here - width,
                        *below = here + width;
            const double sign = (y + row) % 2 == 0 ? 1 : -1;
            double products = 0, squares = 0;
            for (int x = 1; x + 1 < width; ++x) {
                const float along = 0.5F * (here[x + 1] - here[x - 1]);
                products += static_cast<double>(along * (above[x] + below[x] - 2 * here[x]));
                squares += static_cast<double>(along * along);
            }
            pair.product += sign * products;
            pair.square += 2 * squares;
        }
        product += pair.product;
        square += pair.square;
        all.push_back(pair);
    }
    if (!(square > 0)) return {};
    const double shift = product / square;
    double left = 0;
    for (const Pair& pair : all) left += std::pow(pair.product - shift * pair.square, 2);
    return {shift, std::sqrt(left) / square};
}

}  // namespace hord::calib
