// What people may choose about the page: page.toml, strictly read.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/result.h"

namespace hord::firmware::page {

struct PageConfig {
    std::string host = "127.0.0.1";  // the page listens here
    std::uint16_t port = 8070;       // 0: any free one
    std::vector<std::string> names;  // further names and addresses by which browsers and Prometheus may call it
    int viewers = 16;  // browsers that are told of changes at the same time; further ones ask every two seconds

    std::string modbus = "127.0.0.1:502";                 // the station's register server
    std::filesystem::path store = "/var/lib/hord/store";  // its store; "": none
    std::chrono::milliseconds poll{100};                  // the station is asked so often

    std::filesystem::path tokens;  // who may command; empty: nobody, the page only shows
};

// Relative files are relative to the file. Fails with invalid_argument, every problem with its line, and not_found.
Result<PageConfig> load_page_config(const std::filesystem::path& file);
Result<PageConfig> parse_page_config(std::string_view text, const std::filesystem::path& file);

}  // namespace hord::firmware::page
