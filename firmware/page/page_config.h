// The configuration of hord-page: page.toml, read strictly.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::firmware::page {

struct PageConfig {
    std::string host = "127.0.0.1";  // the page listens here
    std::uint16_t port = 8070;       // 0: any free one
    std::vector<std::string> names;  // further host names and addresses that requests may name
    int viewers = 16;  // browsers that receive events at the same time; further ones poll every two seconds

    std::vector<std::string> shifts{"06:00", "14:00", "22:00"};  // starts, HH:MM, in the viewer's local time

    std::string modbus = "127.0.0.1:502";                 // the station's register server
    std::filesystem::path store = "/var/lib/hord/store";  // its store; "": none
    std::chrono::milliseconds poll{100};                  // period of polling the station

    std::filesystem::path tokens;  // file of people who may command; empty: commands are refused
};

std::string lower(std::string_view text);  // of ASCII letters

// Relative paths are relative to the file. Fails with invalid_argument (all problems, with their lines), not_found.
Result<PageConfig> load_page_config(const std::filesystem::path& file);
Result<PageConfig> parse_page_config(std::string_view text, const std::filesystem::path& file);

}  // namespace hord::firmware::page
