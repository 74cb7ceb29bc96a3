// The tokens that a client has used in this boot. Tokens of a counter take one range, so memory stays small.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

namespace hord::firmware {

class UsedTokens {
  public:
    // When there are more ranges, the two that are closest become one. The tokens between them then count as used,
    // too: such a command is refused, and no command is ever executed twice.
    static constexpr std::size_t kMaxRanges = 4096;

    [[nodiscard]] bool contains(std::uint32_t token) const {
        const auto next = after(token);
        return next != ranges_.begin() && std::prev(next)->last >= token;
    }
    void insert(std::uint32_t token) {
        if (contains(token)) return;
        const auto next = ranges_.begin() + (after(token) - ranges_.cbegin());
        if (next != ranges_.begin() && std::prev(next)->last + 1 == token) {
            std::prev(next)->last = token;
            if (next != ranges_.end() && token + 1 == next->first) join(std::prev(next));
        } else if (next != ranges_.end() && token + 1 == next->first) {
            next->first = token;
        } else {
            ranges_.insert(next, {token, token});
        }
        if (ranges_.size() > kMaxRanges) join_closest();
    }
    [[nodiscard]] std::size_t ranges() const { return ranges_.size(); }

  private:
    struct Range {
        std::uint32_t first, last;
    };
    using Ranges = std::vector<Range>;  // in order; a gap between two of them

    [[nodiscard]] Ranges::const_iterator after(std::uint32_t token) const {
        return std::upper_bound(ranges_.begin(), ranges_.end(), token,
                                [](std::uint32_t t, const Range& range) { return t < range.first; });
    }
    void join(Ranges::iterator with_next) {
        with_next->last = std::next(with_next)->last;
        ranges_.erase(std::next(with_next));
    }
    void join_closest() {
        auto closest = ranges_.begin();
        const auto gap = [](Ranges::iterator at) { return std::next(at)->first - at->last; };
        for (auto at = closest; std::next(at) != ranges_.end(); ++at) {
            if (gap(at) < gap(closest)) closest = at;
        }
        join(closest);
    }

    Ranges ranges_;
};

}  // namespace hord::firmware
