// Prints one number for the bits of every distance over many random HORDs. The same on every processor, compiler and
// instruction set: the tests compare it with a literal, and build and run this program for arm64.
#include <bit>
#include <cinttypes>
#include <cstdio>
#include <vector>

#include "algo/features/distance.h"

namespace {

using namespace hord;
using namespace hord::algo;

// xorshift64*: the standard library's distributions differ between platforms.
struct Random {
    std::uint64_t state = 0x9E3779B97F4A7C15U;
    std::uint32_t below(std::uint32_t limit) {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        return static_cast<std::uint32_t>(((state * 0x2545F4914F6CDD1DU) >> 32) % limit);
    }
};

struct Checksum {
    std::uint64_t value = 0xCBF29CE484222325U;  // FNV-1a over 64-bit words
    void add(double d) { value = (value ^ std::bit_cast<std::uint64_t>(d)) * 0x100000001B3U; }
};

std::uint64_t of_random_hords(int bins_i, int bins_j, std::uint32_t full_scale, int count) {
    Random random;
    Checksum sum;
    const auto bins = static_cast<std::uint32_t>(bins_i * bins_j);
    std::vector<std::vector<std::uint16_t>> mass;
    std::vector<Hord> hords;
    for (int n = 0; n < count; ++n) {
        std::vector<std::uint16_t> h(bins);
        const std::uint32_t lit = 1 + random.below(n % 4 == 0 ? bins : 9);
        for (std::uint32_t k = 0; k < lit; ++k)
            h[random.below(bins)] = static_cast<std::uint16_t>(1 + random.below(full_scale));
        mass.push_back(h);
    }
    for (const auto& h : mass) {
        std::uint32_t total = 0;
        for (const auto m : h) total += m;
        hords.push_back({h.data(), total});
    }
    for (std::size_t feature = 0; feature <= static_cast<std::size_t>(kLastDistance); ++feature) {
        auto distance = Distance::create(static_cast<Feature>(feature), bins_i, bins_j);
        std::vector<double> out(hords.size());
        for (std::size_t n = 1; n < hords.size(); ++n) distance->submit(hords[n - 1], hords[n], &out[n]);
        distance->finish();
        for (const double d : out) sum.add(d);
    }
    return sum.value;
}

}  // namespace

int main() {
    const std::uint64_t sums[] = {of_random_hords(9, 9, 255, 800), of_random_hords(15, 15, 65535, 100),
                                  of_random_hords(4, 7, 4095, 400), of_random_hords(3, 3, 2, 800)};
    Checksum all;
    for (const auto s : sums) all.add(std::bit_cast<double>(s));
    std::printf("%016" PRIx64 "\n", all.value);
}
