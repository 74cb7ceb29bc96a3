// Coverage of a soak: how often the core took each event in each state, and which pairs of faults fired together.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <string>
#include <string_view>

#include "firmware/core/enum_values.h"
#include "firmware/core/events.h"
#include "firmware/core/states.h"
#include "hal_sim/world/fault_injection.h"

namespace hord::lab {

inline constexpr auto& kStates = firmware::kValuesOf<firmware::State>;

inline constexpr int kStateCommands = static_cast<int>(firmware::Command::reset);  // have the codes from 1 on

// The kinds of events: each alternative of Event, where each command, each device up or lost, and each kind of edge
// counts as a kind of its own.
inline constexpr std::size_t kEventKinds =
    kStateCommands + 2 * firmware::kDevices + 2 + (std::variant_size_v<firmware::Event> - 4);
[[nodiscard]] std::size_t kind_of(const firmware::Event& event);
[[nodiscard]] std::string name_of_kind(std::size_t kind);

class Coverage {
  public:
    void stepped(firmware::State before, const firmware::Event& event) { ++steps_[index_of(before)][kind_of(event)]; }
    void fired_together(sim::InjectedFault a, sim::InjectedFault b) {
        pairs_.set(static_cast<std::size_t>(a) * sim::kInjectedFaults + static_cast<std::size_t>(b));
    }
    void merge(const Coverage& other);

    [[nodiscard]] std::uint64_t steps(firmware::State state, std::size_t kind) const {
        return steps_[index_of(state)][kind];
    }
    [[nodiscard]] bool together(sim::InjectedFault a, sim::InjectedFault b) const;  // in either order
    [[nodiscard]] std::size_t pairs() const;                                        // of different faults

  private:
    [[nodiscard]] static std::size_t index_of(firmware::State state);
    std::array<std::array<std::uint64_t, kEventKinds>, kStates.size()> steps_{};
    std::bitset<sim::kInjectedFaults * sim::kInjectedFaults> pairs_;
};

// Why the event cannot occur in the state. Empty for a pair that can: the nightly profile must show it. Every pair of
// faults can occur: those that need an encoder get a line with one.
[[nodiscard]] std::string_view unreachable(firmware::State state, std::size_t kind);

// The tables, for people. `complete` becomes true if exactly the reachable pairs occurred.
[[nodiscard]] std::string describe(const Coverage& coverage, bool* complete = nullptr);

}  // namespace hord::lab
