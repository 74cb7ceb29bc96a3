#include "algo/residual.h"

#include <algorithm>

namespace hord::algo {
namespace {

std::size_t index(int k) { return static_cast<std::size_t>(k); }

void keep(const Hord& h, std::int64_t other_sum, int bins, ResidualSide& side) {
    const LitBins lit(h.mass, bins);
    side.count = 0;
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            side.mass[index(side.count)] = static_cast<double>(h.mass[k] * other_sum);
            side.bin[index(side.count)] = static_cast<std::uint8_t>(k);
            ++side.count;
        }
    }
}

}  // namespace

bool ResidualSide::precedes(const ResidualSide& other) const {
    if (count != other.count) return count < other.count;
    if (bin[0] != other.bin[0]) return bin[0] < other.bin[0];  // always, where what both share is gone
    const auto [mine, its] = std::mismatch(bin.begin(), bin.begin() + count, other.bin.begin());
    if (mine != bin.begin() + count) return *mine < *its;
    return std::lexicographical_compare(mass.begin(), mass.begin() + count, other.mass.begin(), other.mass.begin() + count);
}

// No branches on the data: they would be guesses.
void find_residual(const Hord& a, const Hord& b, int bins, ResidualSide& more, ResidualSide& less) {
    const std::uint16_t* const mass_a = a.mass;
    const std::uint16_t* const mass_b = b.mass;
    const std::int64_t sum_a = a.sum;
    const std::int64_t sum_b = b.sum;
    const LitBins lit(mass_a, mass_b, bins);
    std::size_t n_more = 0, n_less = 0;
    for (int w = 0; w < lit.words(); ++w) {
        for (std::uint64_t rest = lit.word(w); rest != 0; rest &= rest - 1) {
            const int k = w * 64 + __builtin_ctzll(rest);
            const std::int64_t d = mass_a[k] * sum_b - mass_b[k] * sum_a;
            const auto mass = static_cast<double>(d);
            more.mass[n_more] = mass;
            more.bin[n_more] = static_cast<std::uint8_t>(k);
            n_more += d > 0 ? 1U : 0U;
            less.mass[n_less] = -mass;
            less.bin[n_less] = static_cast<std::uint8_t>(k);
            n_less += d < 0 ? 1U : 0U;
        }
    }
    more.count = static_cast<int>(n_more);
    less.count = static_cast<int>(n_less);
}

void keep_all(const Hord& a, const Hord& b, int bins, ResidualSide& more, ResidualSide& less) {
    keep(a, b.sum, bins, more);
    keep(b, a.sum, bins, less);
}

}  // namespace hord::algo
