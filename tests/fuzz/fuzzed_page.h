// A page without a store and a station, for fuzz targets.
#pragma once

#include <functional>
#include <utility>

#include "firmware/page/pages.h"

namespace hord::firmware::page {

struct FuzzedPage {
    static constexpr const char* kToken = "a-token-that-no-input-holds-0123456789";

    explicit FuzzedPage(std::function<void(Command)> executed)
        : pages{{config,
                 tokens,
                 viewers,
                 live,
                 results,
                 frames,
                 pictures,
                 [run = std::move(executed)](Command code, std::uint32_t, std::uint32_t,
                                             const std::string&) -> Result<modbus::Client::Reply> {
                     run(code);
                     return modbus::Client::Reply{CommandState::completed, CommandError::none, 0, "none"};
                 },
                 {},
                 "fuzz"}} {}

    PageConfig config;
    Tokens tokens = *Tokens::parse(std::string("anna ") + kToken + "\n", "tokens");
    Viewers viewers{2};
    Live live{viewers};
    Results results{"/nonexistent"};
    KeptFrames frames{"/nonexistent"};
    PartPictures pictures;
    Pages pages;
};

}  // namespace hord::firmware::page
