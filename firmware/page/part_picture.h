// What the inspection saw in a kept frame: its feature map with the defects marked, and the same in words. The frame is
// judged again, in this process, with the recipe that is written in it; the station is not asked.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/page/kept_frames.h"

namespace hord::firmware::page {

struct DrawnPart {
    std::string frame;              // the file's name
    std::vector<std::uint8_t> png;  // the map
    std::string
        found;  // JSON: part, verdict, sentence, map, defects in words, whether the judgement is the same as then
};

class PartPictures {
  public:
    // Feature: "" (the one that decided), or one of those that the recipe judges by: "emd" (or another distance's
    // name), "slope", "transmission"; "z_score" with a reference and no distance. Fails with invalid_argument (another
    // feature), unreadable (metadata that are not a station's), and what the pipeline says of the recipe. One is drawn
    // at a time.
    Result<std::shared_ptr<const DrawnPart>> draw(const KeptFrame& kept, const std::string& feature);

    PartPictures();
    ~PartPictures();

  private:
    static constexpr std::size_t kMaxCached = 12;
    struct Parts;
    std::mutex mutex_;
    std::unique_ptr<Parts> parts_;
    std::deque<std::pair<std::string, std::shared_ptr<const DrawnPart>>> drawn_;  // newest first
};

// Of the brightest samples (all but a thousandth are darker), 1: full scale.
double brightest_share(const FrameView& frame);

}  // namespace hord::firmware::page
