// Loops over lenslets with a test that is true or false for each. `suits(k)` combines values of lenslet k by arithmetic
// and bits, without branches: compilers then test a block of lenslets by vectors.
#pragma once

#include <cstddef>
#include <cstdint>

namespace hord::algo {

constexpr std::size_t kScanBlock = 64;

// How many of the lenslets first..last-1 suit.
template <class Suits>
std::size_t count_suiting(std::size_t first, std::size_t last, Suits&& suits) {
    static_assert(kScanBlock < 256);
    std::size_t all = 0, k = first;
    for (; k + kScanBlock <= last; k += kScanBlock) {
        std::uint8_t here = 0;
        for (std::size_t b = 0; b < kScanBlock; ++b) here = static_cast<std::uint8_t>(here + (suits(k + b) ? 1 : 0));
        all += here;
    }
    for (; k < last; ++k) all += suits(k) ? 1 : 0;
    return all;
}

// The first of the lenslets first..last-1 that suits; `last` if none does.
template <class Suits>
std::size_t first_suiting(std::size_t first, std::size_t last, Suits&& suits) {
    for (; first + kScanBlock <= last; first += kScanBlock) {
        std::uint8_t any = 0;
        for (std::size_t b = 0; b < kScanBlock; ++b) any = static_cast<std::uint8_t>(any | (suits(first + b) ? 1 : 0));
        if (any != 0) break;
    }
    while (first < last && !suits(first)) ++first;
    return first;
}

// Calls visit(k) for the lenslets first..last-1 that suit, in ascending order. Blocks without one are skipped, so that
// it is fast if few suit. visit() may change what lenslets suit: those after k in any way that leaves fewer of them.
template <class Suits, class Visit>
void for_each_suiting(std::size_t first, std::size_t last, Suits&& suits, Visit&& visit) {
    std::size_t k = first;
    const auto look_at = [&](std::size_t end) {
        for (; k < end; ++k) {
            if (suits(k)) visit(k);
        }
    };
    while (k + kScanBlock <= last) {
        std::uint8_t any = 0;
        for (std::size_t b = 0; b < kScanBlock; ++b) any = static_cast<std::uint8_t>(any | (suits(k + b) ? 1 : 0));
        if (any != 0) look_at(k + kScanBlock);
        else k += kScanBlock;
    }
    look_at(last);
}

}  // namespace hord::algo
