// What a feature costs: processor time of one thread for a frame, decoding included.
#pragma once

#include "lab/experiment/result_cache.h"
#include "lab/tradeoff/tradeoff_parts.h"

namespace hord::lab {

// Measured on the lens of hal_sim/scenes/bubble.toml with its bubble, 111x111 lenslets (of which a stride uses fewer),
// with the point's bins and light; given for 555x555, 25 times as many: rows are streamed, so time grows with their
// number. By feature's name:
//   {"median_ms", "p99_ms", "runs"}
// Features take turns, so that what else the machine does falls on each alike.
// Also "sum the bytes": reading the frame once, the least that anything can cost.
Result<Json> time_features(const TradeoffPoint& point, std::uint64_t seed, int threads, bool quick);

// How far the cheaper distances are from the exact one they stand for, on the same frame: mean and 99th percentile of
// |value - emd| over judged lenslets, bin pitches; by name. And "sinkhorn": entropic transport (transport_check.h,
// which no station uses) against the exact distance of single pairs, with "pairs", "rounds", and "pair_us", "exact_us"
// of processor time a pair.
Result<Json> approximations_of_emd(const TradeoffPoint& point, std::uint64_t seed, int threads);

}  // namespace hord::lab
