// The metadata of a kept frame: one JSON object with everything that a replay needs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "common/result.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

// What an inspection found, to the bit.
struct Judgement {
    std::string verdict, reason;
    float score = 0;
    Json defects;             // all of them
    std::string maps_sha256;  // of the feature maps
    // The gradient's map held bounds (algo::MapSet::judged). Frames kept by older versions have exact maps.
    bool maps_of_bounds = false;
    bool bounded = false;      // algo::Inspection::bounded
    bool out_of_time = false;  // and why: maps, score and defects of such a judgement do not come again
    bool operator==(const Judgement&) const = default;
};
Judgement judgement_of(const algo::Inspection& inspection);
Json to_json(const Judgement& judgement);

// The feature maps and the mask of an inspection, one after the other: what `maps_sha256` covers.
std::vector<std::uint8_t> bytes_of_maps(const algo::Inspection& inspection);

struct FrameMetadata {
    std::string station, software;
    std::uint32_t boot = 0, part = 0;
    UtcMicros time_us = 0;
    std::string role;           // "reject" (the part did not pass), "before" and "after" such a part, "sample"
    std::uint32_t trigger = 0;  // of "before" and "after": that part
    algo::Extents grid;
    int bits = 8;                          // a sample
    std::optional<std::uint32_t> dark_dn;  // algo::Inspection::dark_dn; none: kept by an older version
    Judgement judgement;
    std::string samples_sha256;
    std::string recipe;  // the whole text of the recipe that judged it

    [[nodiscard]] std::string to_json() const;  // one line
    // Fails with unreadable; `name`: of the frame, for the message.
    static Result<FrameMetadata> from_json(const std::string& text, const std::string& name);
};

}  // namespace hord::firmware::store
