// What a station tells as Sparkplug metrics: their names, aliases, types and units.
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

// Blocks that are told: everything but results, which come from the store, and the PLC's commands, which are not ours.
std::vector<BlockId> published_blocks();

// One metric a register of these blocks, with name ("Station/STATUS/state"), alias, type, unit and value; null without
// a reading. Heartbeats and ages, which change with every look, are left out.
std::vector<Metric> station_metrics(const std::vector<Reading>& readings);

// A result's metrics: with values at its time, by alias alone; without one, as a birth declares them: names, types,
// null.
std::vector<Metric> result_metrics(const store::StoredResult* result, const std::string& store_id, bool historical);

}  // namespace hord::firmware::mqtt
