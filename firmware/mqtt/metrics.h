// Registers and results as Sparkplug metrics: names, aliases, types and units.
//
// Alias of a register is its address in the register map, which never changes; those of results begin at kResultAlias.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/mqtt/payload.h"
#include "firmware/registers/register_map.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::mqtt {

constexpr std::uint64_t kNodeAlias = 20'000, kResultAlias = 20'100;

// All blocks but the results (they come from the store) and the PLC's commands.
std::vector<BlockId> published_blocks();

// One metric a register of these blocks, with name ("Station/STATUS/state"), alias, type, unit and value; null without
// a reading. Heartbeats and ages are left out: they change at every poll.
std::vector<Metric> station_metrics(const std::vector<Reading>& readings);

// A result's metrics: with values at its time, by alias alone; without one, as a birth declares them: names, types,
// null.
std::vector<Metric> result_metrics(const store::StoredResult* result, const std::string& store_id, bool historical);

}  // namespace hord::firmware::mqtt
