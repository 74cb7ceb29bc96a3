// After each poll of the station: announces the frame of a new reject, and measures the brightness of kept frames.
//
// A frame is archived at its verdict, its result is published past the ejector: the page shows a reject earlier.
#pragma once

#include <chrono>

#include "firmware/page/kept_frames.h"
#include "firmware/page/live.h"
#include "firmware/page/part_picture.h"

namespace hord::firmware::page {

class LatestPicture {
  public:
    LatestPicture(Live& live, Viewers& viewers, KeptFrames& frames, PartPictures& pictures)
        : live_(live), viewers_(viewers), frames_(frames), pictures_(pictures) {}

    void poll();

  private:
    static constexpr auto kLightEvery = std::chrono::seconds(2);
    using Clock = std::chrono::steady_clock;

    Live& live_;
    Viewers& viewers_;
    KeptFrames& frames_;
    PartPictures& pictures_;
    Clock::time_point light_at_{};
};

}  // namespace hord::firmware::page
