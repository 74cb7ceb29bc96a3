// A noisy serial cable: carries bytes between two lines in raw mode and adds noise while that is enabled.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

namespace hord::rig {

class Cable {
  public:
    // Opens both lines, at 19200 baud 8E1 if they are UARTs. Throws std::runtime_error.
    Cable(const std::string& one, const std::string& other, std::uint64_t seed);
    ~Cable();
    Cable(const Cable&) = delete;
    Cable& operator=(const Cable&) = delete;

    void hum(bool on) {
        hums_ = on;
    }  // any thread: a byte of noise before every fourth piece, and a flipped bit in every eighth
    [[nodiscard]] int disturbed() const { return disturbed_; }

  private:
    void run(std::uint64_t seed);
    int ends_[2] = {-1, -1};
    std::atomic<bool> hums_ = false, stopping_ = false;
    std::atomic<int> disturbed_ = 0;
    std::thread thread_;
};

}  // namespace hord::rig
