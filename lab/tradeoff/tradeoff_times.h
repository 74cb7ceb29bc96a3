// The processor time of each feature for a frame, on one thread, with decoding.
#pragma once

#include "lab/experiment/result_cache.h"
#include "lab/tradeoff/tradeoff_parts.h"

namespace hord::lab {

// Measured on the lens of hal_sim/scenes/bubble.toml with its bubble, 111x111 lenslets (of which a stride uses fewer),
// with the point's bins and light. Times are scaled by 25, to 555x555 lenslets: rows are streamed, so time is
// proportional to their number. By feature's name:
//   {"median_ms", "p99_ms", "runs"}
// Features take turns, so that other load disturbs all alike.
// Also "sum the bytes": reading the frame once, a lower bound.
Result<Json> time_features(const TradeoffPoint& point, std::uint64_t seed, int threads, bool quick);

// Errors of the cheaper distances against the exact one, on the same frame: mean and 99th percentile of |value - emd|
// over judged lenslets, bin pitches; by name. And "sinkhorn": entropic transport (transport_check.h,
// which no station uses) against the exact distance of single pairs, with "pairs", "rounds", and "pair_us", "exact_us"
// of processor time a pair.
Result<Json> approximations_of_emd(const TradeoffPoint& point, std::uint64_t seed, int threads);

}  // namespace hord::lab
