#include "firmware/page/latest_picture.h"

#include <nlohmann/json.hpp>

namespace hord::firmware::page {

void LatestPicture::poll() {
    if (const auto kept = frames_.newest_reject()) {
        const auto metadata = nlohmann::json::parse(kept->frame.metadata, nullptr, false);
        const auto number = [&](const char* key) {
            return metadata.is_object() && metadata.contains(key) && metadata[key].is_number_integer()
                ? metadata[key].get<std::int64_t>()
                : 0;
        };
        if (viewers_.count() > 0)
            (void)pictures_.draw(*kept, "");  // ready when they ask; why it fails they are told then
        live_.set_picture(static_cast<std::uint32_t>(number("boot")), static_cast<std::uint32_t>(number("part")),
                          number("time_us") / 1000);
    }
    const auto now = Clock::now();
    if (now - light_at_ < kLightEvery) return;
    light_at_ = now;
    if (const auto kept = frames_.newest()) live_.set_light(brightest_share(kept->frame.frame.view()));
}

}  // namespace hord::firmware::page
