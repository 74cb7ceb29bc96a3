#include "tests/support/emd_threshold/emd_bounds.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/fixed.h"

namespace hord::algo {
namespace {

constexpr double kMargin = 0x1p-35;  // of the largest cost

double norm(double x, double y) { return std::sqrt(x * x + y * y); }

}  // namespace

EmdBounds::EmdBounds(const GroundDistance& ground)
    : ground_(ground), x_(ground.directions(), 1.0, 0.0), y_(ground.directions(), 0.0, 1.0),
      margin_(ground.largest() * kMargin) {
    const auto bins = static_cast<std::size_t>(ground.bins());
    for (const Order order : {Order::by_lines, Order::by_columns}) {
        auto& [bin_at, place_of, is_identity] = orders_[static_cast<std::size_t>(order)];
        bin_at.resize(bins);
        std::iota(bin_at.begin(), bin_at.end(), std::uint8_t{0});
        std::stable_sort(bin_at.begin(), bin_at.end(), [&](std::uint8_t p, std::uint8_t q) {
            const Direction a = ground.directions()[p], b = ground.directions()[q];
            return order == Order::by_lines ? std::pair(a.y, a.x) < std::pair(b.y, b.x)
                                            : std::pair(a.x, a.y) < std::pair(b.x, b.y);
        });
        place_of.resize(bins);
        for (std::size_t at = 0; at < bins; ++at) place_of[bin_at[at]] = static_cast<std::uint8_t>(at);
        is_identity = std::is_sorted(bin_at.begin(), bin_at.end());
    }
}

void EmdBounds::set_pair(const Hord& a, const Hord& b) {
    difference_.count = 0;
    not_shared_ = 0;
    if (a.sum == 0 || b.sum == 0) return;
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit);
    unit_ = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    OccupiedBins(a.mass, b.mass, ground_.bins()).for_each([&](int k) {
        const std::int64_t d = std::int64_t{a.mass[k]} * b.sum - std::int64_t{b.mass[k]} * a.sum;
        difference_.bin[static_cast<std::size_t>(difference_.count)] = static_cast<std::uint8_t>(k);
        difference_.mass[static_cast<std::size_t>(difference_.count)] = static_cast<double>(d);
        difference_.count += d != 0 ? 1 : 0;
        not_shared_ += std::max(d, std::int64_t{0});
    });
}

double EmdBounds::lower() const {
    if (difference_.count == 0 || ground_.threshold() != GroundDistance::kNoThreshold) return 0;
    const double x = x_.distance(difference_) / unit_;
    const double y = y_.distance(difference_) / unit_;
    const double least = ground_.norm() == GroundNorm::euclidean ? norm(x, y)
        : ground_.norm() == GroundNorm::manhattan                ? x + y
                                                                 : x * x + y * y;
    return std::max(0.0, least - margin_);
}

double EmdBounds::upper_by_mass() const {
    return not_shared_ == 0 ? 0 : static_cast<double>(not_shared_) / unit_ * ground_.largest() + margin_;
}

double EmdBounds::upper(Order order) const {
    return difference_.count == 0 ? 0 : plan_in_order(orders_[static_cast<std::size_t>(order)]) / unit_ + margin_;
}

// Visits the bins in order; the first surplus moves to the first deficit until one is used up, and so on.
double EmdBounds::plan_in_order(const BinOrder& order) const {
    // Bins visited and not yet balanced: all with surplus (> 0), or all with deficit.
    std::array<std::uint8_t, kMaxBinCount> waiting_bin;
    std::array<double, kMaxBinCount> waiting_mass;
    std::size_t first = 0, last = 0;
    double work = 0;
    const auto pass = [&](std::uint8_t bin, double left) {
        while (left != 0 && first < last && (waiting_mass[first] < 0) != (left < 0)) {
            const double moved = std::min(std::abs(left), std::abs(waiting_mass[first]));
            work += moved * ground_(waiting_bin[first], bin);
            const double sign = left < 0 ? 1.0 : -1.0;
            left += sign * moved;
            waiting_mass[first] -= sign * moved;
            if (waiting_mass[first] == 0) ++first;
        }
        if (left != 0) {
            waiting_bin[last] = bin;
            waiting_mass[last++] = left;
        }
    };
    const auto count = static_cast<std::size_t>(difference_.count);
    if (order.is_identity) {
        for (std::size_t k = 0; k < count; ++k) pass(difference_.bin[k], difference_.mass[k]);
        return work;
    }
    std::uint64_t differs[(kMaxBinCount + 63) / 64] = {};
    std::array<double, kMaxBinCount> mass;
    for (std::size_t k = 0; k < count; ++k) {
        const auto place = order.place_of[difference_.bin[k]];
        mass[place] = difference_.mass[k];
        differs[place / 64] |= std::uint64_t{1} << (place % 64);
    }
    for (std::size_t w = 0; w < std::size(differs); ++w) {
        for (std::uint64_t rest = differs[w]; rest != 0; rest &= rest - 1) {
            const auto place = w * 64 + static_cast<std::size_t>(__builtin_ctzll(rest));
            pass(order.bin_at[place], mass[place]);
        }
    }
    return work;
}

}  // namespace hord::algo
