// Whether the process before this one ended with parts on the line: a file that is there while the line may be in use.
//
// Made before the line first runs, removed only by a process that ends in order with an empty line. A process that
// died, or a machine that lost its power, leaves it behind.
#pragma once

#include <filesystem>
#include <fstream>

namespace hord::firmware {

class OccupancyMarker {
  public:
    // No folder: nothing is remembered, and nothing is ever left behind.
    explicit OccupancyMarker(const std::filesystem::path& folder)
        : file_(folder.empty() ? folder : folder / "line-in-use") {}

    [[nodiscard]] bool left_behind() const {
        std::error_code error;
        return !file_.empty() && std::filesystem::exists(file_, error);
    }
    void raise() const {
        if (!file_.empty()) std::ofstream(file_) << "Parts may be on the line.\n";
    }
    void clear() const {
        std::error_code error;
        if (!file_.empty()) std::filesystem::remove(file_, error);
    }

  private:
    std::filesystem::path file_;
};

}  // namespace hord::firmware
