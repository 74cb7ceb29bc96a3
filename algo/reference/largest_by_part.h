// The three largest of many values, at most one of each part.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace hord::algo {

class LargestByPart {
  public:
    // Values of 0 and below are not kept.
    void add(float value, std::uint32_t part) {
        if (!(value > values_.back())) return;
        std::size_t at = 0;
        for (; values_[at] >= value; ++at) {
            if (parts_[at] == part) return;
        }
        std::size_t last = at;  // where the part's smaller value was, or the end
        while (last + 1 < kKept && !(values_[last] > 0 && parts_[last] == part)) ++last;
        for (; last > at; --last) values_[last] = values_[last - 1], parts_[last] = parts_[last - 1];
        values_[at] = value, parts_[at] = part;
    }
    void add(const LargestByPart& other) {
        for (std::size_t k = 0; k < kKept; ++k) add(other.values_[k], other.parts_[k]);
    }

    static constexpr std::size_t kKept = 3;
    // 0 if there are fewer.
    [[nodiscard]] float value(std::size_t rank) const { return values_[rank]; }
    [[nodiscard]] std::uint32_t part(std::size_t rank) const { return parts_[rank]; }
    // The second largest of the other parts.
    [[nodiscard]] float second_without(std::uint32_t part) const {
        std::size_t others = 0;
        for (std::size_t k = 0; k < kKept; ++k) {
            if (values_[k] > 0 && parts_[k] != part && ++others == 2) return values_[k];
        }
        return 0;
    }

  private:
    std::array<float, kKept> values_{};  // descending
    std::array<std::uint32_t, kKept> parts_{};
};

}  // namespace hord::algo
