// A camera as a listing shows it: hordctl devices.
#pragma once

#include <string>
#include <vector>

namespace hord::hal {

struct ListedFormat {
    std::string name = {};                // the library's: "GREY", "R8", "Mono8"
    int bits = 0;                         // 8, 10, 12 or 16; 0: the station cannot use it
    int width_px = 0, height_px = 0;      // the largest; 0: not said
    std::vector<std::string> sizes = {};  // "1280x960", or a range
    bool operator==(const ListedFormat&) const = default;
};

struct ListedCamera {
    std::string name = {};    // what sensor.device or sensor.camera takes
    std::string text = {};    // model, serial number, address
    std::string holder = {};  // who has it now; nothing else was read from it then. Empty: nobody
    std::vector<ListedFormat> formats = {};
    std::vector<std::string> triggers = {};  // sources; empty: it has none, or does not say
    std::string problem = {}, cure = {};     // why it could not be read
    bool operator==(const ListedCamera&) const = default;
};

}  // namespace hord::hal
