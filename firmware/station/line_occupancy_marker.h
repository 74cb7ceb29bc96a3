// A marker file that exists while parts may be on the line. The next process reads from it whether parts were left
// there.
//
// Created before the line first runs; removed only at an orderly end with an empty line. A crash or a loss of power
// leaves it behind.
#pragma once

#include <filesystem>
#include <fstream>

namespace hord::firmware {

class OccupancyMarker {
  public:
    // Empty folder: no file, left_behind() is false.
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
