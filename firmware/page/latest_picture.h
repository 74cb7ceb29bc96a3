// Looks, after each round of asking the station, whether the frame of another reject has come, and how bright kept
// frames are.
//
// A frame is kept at its verdict; its result can be read when the part is past the ejector. So people see a reject
// before that.
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
