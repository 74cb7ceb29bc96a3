// The exact feature map of a kept frame with its defects marked, and a description in words. The frame is inspected
// again, in this process, with the recipe of its metadata.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/page/kept_frames.h"
#include "firmware/store/frames/replay.h"

namespace hord::firmware::page {

struct DrawnPart {
    std::vector<std::uint8_t> png;  // the map
    std::string found;  // JSON: part, verdict, sentence, map, the maps there are, the worst defects in words with their
                        // places (lenslets, px, and mm if the recipe knows lenslet_mm), how many there are, whether the
                        // judgement is the same as then
};

class PartPictures {
  public:
    // `feature`: "" (the one that decided), or one of the recipe's: "emd" (or another distance's name), "slope",
    // "transmission", with a reference "z-score"; "sums" (the light). Fails with invalid_argument (another feature),
    // unreadable (metadata that are not a station's), and as Replay::inspect() does. One is drawn at a time.
    Result<std::shared_ptr<const DrawnPart>> draw(const KeptFrame& kept, const std::string& feature);

  private:
    static constexpr std::size_t kMaxCached = 12;
    std::mutex mutex_;
    store::Replay replay_;
    std::deque<std::pair<std::string, std::shared_ptr<const DrawnPart>>> drawn_;  // newest first
};

// The 99.9th percentile of the samples, as a share of the full scale.
double brightest_share(const FrameView& frame);

}  // namespace hord::firmware::page
