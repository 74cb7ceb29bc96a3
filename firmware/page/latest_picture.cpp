#include "firmware/page/latest_picture.h"

namespace hord::firmware::page {

void LatestPicture::look() {
    const auto now = Clock::now();
    if (const auto reject = live_.newest_reject()) {
        if (const std::string key = reject->key(); key != wanted_) {
            wanted_ = key;
            wanted_since_ = now;
            found_ = false;
        }
        if (!found_ && now - wanted_since_ < kPatience) {
            if (const auto kept = frames_.find(reject->boot, reject->part)) {
                found_ = true;
                if (viewers_.count() > 0) (void)pictures_.draw(*kept, "");  // ready when they ask; why it fails they are told then
                live_.saw_picture(*reject);
            }
        }
    }
    if (now - light_at_ < kLightEvery) return;
    light_at_ = now;
    if (const auto kept = frames_.newest()) live_.saw_light(brightest_share(kept->frame.frame.view()));
}

}  // namespace hord::firmware::page
