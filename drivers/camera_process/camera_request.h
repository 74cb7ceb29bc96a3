// A driver's options as text, from the station to the process that holds the camera. The driver gives the options' JSON
// (NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE).
#pragma once

#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace hord::drivers {

template <class Options>
std::string text_of_request(const Options& options) {
    return nlohmann::json(options).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// None: malformed.
template <class Options>
std::optional<Options> parse_request(const std::string& request) {
    try {
        return nlohmann::json::parse(request).get<Options>();
    } catch (const nlohmann::json::exception&) {
        return std::nullopt;
    }
}

}  // namespace hord::drivers
