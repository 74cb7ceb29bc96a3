// The person at the rig's line: watches the station's registers over Modbus TCP and, when it stands and the belt has
// been cleared, resets it. Keeps the faults and counters it has read, for the final check.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>

namespace hord::rig {

class Person {
  public:
    explicit Person(const std::string& station);  // "127.0.0.1:502"; reconnects when it is lost
    ~Person();
    Person(const Person&) = delete;
    Person& operator=(const Person&) = delete;

    void may_reset(bool may) { may_reset_ = may; }  // all methods: any thread
    [[nodiscard]] bool executes() const { return executes_; }
    [[nodiscard]] int resets() const { return resets_; }
    // Bits of `faults_latched` and the line stop, each accumulated since the previous call.
    [[nodiscard]] std::uint32_t take_faults() { return faults_.exchange(0); }
    [[nodiscard]] bool take_line_stop() { return line_stop_.exchange(false); }
    [[nodiscard]] std::uint32_t reject_failed() const { return reject_failed_; }  // since the station's start

  private:
    void run(const std::string& station);
    std::atomic<bool> stopping_ = false, may_reset_ = true, executes_ = false, line_stop_ = false;
    std::atomic<int> resets_ = 0;
    std::atomic<std::uint32_t> faults_ = 0, reject_failed_ = 0;
    std::thread thread_;
};

}  // namespace hord::rig
