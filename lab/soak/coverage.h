// What a soak has exercised: every (state, event) pair that the core has stepped through, every pair of faults.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <string>
#include <string_view>

#include "firmware/core/enum_values.h"
#include "firmware/core/events.h"
#include "firmware/core/states.h"
#include "hal_sim/world/faults.h"

namespace hord::lab {

using namespace firmware;

inline constexpr auto& kStates = kValuesOf<State>;

// What a step is about: each alternative of Event; commands, devices up and lost, and the two kinds of edges one by
// one.
inline constexpr std::size_t kEventKinds = kStateCommands + 2 * kDevices + 2 + (std::variant_size_v<Event> - 4);
[[nodiscard]] std::size_t kind_of(const Event& event);
[[nodiscard]] std::string name_of_kind(std::size_t kind);

class Coverage {
  public:
    void stepped(State before, const Event& event) { ++steps_[index_of(before)][kind_of(event)]; }
    void fired_together(sim::Fault a, sim::Fault b) {
        pairs_.set(static_cast<std::size_t>(a) * sim::kFaults + static_cast<std::size_t>(b));
    }
    void merge(const Coverage& other);

    [[nodiscard]] std::uint64_t steps(State state, std::size_t kind) const { return steps_[index_of(state)][kind]; }
    [[nodiscard]] bool together(sim::Fault a, sim::Fault b) const;  // in either order
    [[nodiscard]] std::size_t pairs() const;                        // of different faults

  private:
    [[nodiscard]] static std::size_t index_of(State state);
    std::array<std::array<std::uint64_t, kEventKinds>, kStates.size()> steps_{};
    std::bitset<sim::kFaults * sim::kFaults> pairs_;
};

// Why a pair does not come about; empty: it does, and the nightly profile must show it.
[[nodiscard]] std::string_view unreachable(State state, std::size_t kind);
[[nodiscard]] std::string_view unreachable(sim::Fault a, sim::Fault b);

// The tables, for people; `complete` tells whether every reachable pair was seen.
[[nodiscard]] std::string describe(const Coverage& coverage, bool* complete = nullptr);

}  // namespace hord::lab
