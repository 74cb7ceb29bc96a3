// The GPIO chips of a machine and their lines. No line is requested, so nothing moves.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace hord::drivers {

struct ListedLine {
    unsigned offset = 0;
    std::string name;                   // empty: it has none
    std::optional<std::string> holder;  // none: free; empty: the holder has no name
    bool output = false;
};

struct ListedChip {
    std::string path = {}, label = {};
    std::vector<ListedLine> lines = {};
    std::string problem = {}, cure = {};  // why it could not be read
};

// The chips in the folder `dev` ("/dev"), in the order of their numbers.
std::vector<ListedChip> list_gpio_chips(const std::filesystem::path& dev);

}  // namespace hord::drivers
