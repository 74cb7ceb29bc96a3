// JSON as the store and the programs that read it write it: with nlohmann-json, keys in the order of insertion.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace hord::firmware::store {

using Json = nlohmann::ordered_json;

// One line for indent -1, otherwise `indent` blanks a level. Bytes that are not UTF-8 become U+FFFD.
inline std::string to_text(const Json& json, int indent = -1) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// A float with its own shortest digits, which read back to the bit: 0.1 and 40. nlohmann-json alone would write those
// of its double: 0.10000000149011612 and 40.0. Null for NaN and infinity.
Json float_number(float value);

}  // namespace hord::firmware::store
