// Looks, after each round of asking the station, whether the frame of the newest reject has come, and how bright kept frames are.
#pragma once

#include <chrono>
#include <string>

#include "firmware/page/kept_frames.h"
#include "firmware/page/live.h"
#include "firmware/page/part_picture.h"

namespace hord::firmware::page {

class LatestPicture {
  public:
    LatestPicture(Live& live, Viewers& viewers, KeptFrames& frames, PartPictures& pictures) : live_(live), viewers_(viewers), frames_(frames), pictures_(pictures) {}

    void look();

  private:
    static constexpr auto kPatience = std::chrono::seconds(5);  // then no frame of it is kept
    static constexpr auto kLightEvery = std::chrono::seconds(2);
    using Clock = std::chrono::steady_clock;

    Live& live_;
    Viewers& viewers_;
    KeptFrames& frames_;
    PartPictures& pictures_;
    std::string wanted_;
    bool found_ = false;
    Clock::time_point wanted_since_{}, light_at_{};
};

}  // namespace hord::firmware::page
