// Watches the real levels of the collimators' lines of a gpio-sim chip through the simulator's side, and drives its
// light barrier's line. `chip` is the chip's folder in configfs (/sys/kernel/config/gpio-sim/NAME).
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "drivers/hal/clock.h"

namespace hord::rig {

// The simulator's folder of the line of this name; throws std::runtime_error when there is none.
[[nodiscard]] std::filesystem::path folder_of_line(const std::filesystem::path& chip, const std::string& name);

class DrivenLine {
  public:
    DrivenLine(const std::filesystem::path& chip, const std::string& name);
    ~DrivenLine();
    DrivenLine(const DrivenLine&) = delete;
    DrivenLine& operator=(const DrivenLine&) = delete;
    void drive(bool high);

  private:
    int fd_;
};

// A thread polls every 0.5 ms: the kernel does not report changes of a simulated output.
class LampWatch {
  public:
    using Told = std::function<void(std::uint32_t lit, hal::TimePoint at)>;  // on the watching thread; bit k is line k
    LampWatch(const hal::Clock& clock, const std::filesystem::path& chip, const std::vector<std::string>& lines,
              Told told);
    ~LampWatch();
    LampWatch(const LampWatch&) = delete;
    LampWatch& operator=(const LampWatch&) = delete;

  private:
    std::vector<int> fds_;
    std::atomic<bool> stopping_ = false;
    std::thread thread_;
};

}  // namespace hord::rig
