// Random numbers as a function of (seed, place, turn): without state, independent of the order of calls, the same bits
// on every machine.
#pragma once

#include <cstdint>

namespace hord::sim {

// Philox 4x32-10 (J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011), one block at a time.
class Noise {
  public:
    // Draws of different (place, purpose) are independent; the same ones repeat.
    Noise(std::uint64_t seed, std::uint64_t place, std::uint32_t purpose = 0);

    double uniform();                    // (0, 1), multiples of 2^-53 plus 2^-54
    double normal();                     // mean 0, variance 1: M. Wichura, AS 241 (1988), of one uniform()
    std::uint64_t poisson(double mean);  // 0 <= mean < 2^48: by inversion below 10, else W. Hörmann, PTRS (1993)

    static constexpr double kLargestNormal = 8.3;  // no normal() is further from 0: uniform() has 53 bits

  private:
    std::uint32_t key_[2];
    std::uint32_t place_[2];
    std::uint32_t purpose_, block_ = 0;
    std::uint32_t word_[4];
    int left_ = 0;
};

// One block: ten rounds of Philox 4x32 over `counter` with `key`, in place of the counter.
void philox(std::uint32_t counter[4], const std::uint32_t key[2]);

}  // namespace hord::sim
