// Runs a program as a person would, and keeps its output.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

namespace hord::test {

struct Said {
    int status = -1;  // exit status; 128 + signal when killed by one
    std::string out, err;
};

// Part of a station's configuration: a line for `--rate 2` with all times long enough for a busy machine.
inline constexpr const char* kRoomyLine =
    "[line]\nexposure_delay_ms = 500\ntransport_ms = 1500\nmin_gap_ms = 450\n[timing]\ntrigger_lead_ms = "
    "400\nframe_timeout_ms = 500\n"
    "[rejector]\nearly_ms = 200\npulse_ms = 400\nresponse_timeout_ms = 500\nconfirm_timeout_ms = 600\n";

// Runs `program` (a name in the build's bin folder, or a path) to its end; kills it after `patience` (status 128 + 9).
Said run(const std::string& program, const std::vector<std::string>& arguments,
         std::chrono::seconds patience = std::chrono::seconds(120));

// A program that runs in parallel with the test. The destructor interrupts it (SIGINT) and waits for its end.
class Running {
  public:
    Running(const std::string& program, const std::vector<std::string>& arguments);
    ~Running();
    Running(const Running&) = delete;
    Running& operator=(const Running&) = delete;

    // Waits until the program has written `text` on either stream; false when it ends or `patience` is over first.
    bool says(const std::string& text, std::chrono::seconds patience = std::chrono::seconds(60));
    [[nodiscard]] const Said& so_far() const;  // without the exit status
    void signal(int signal);
    [[nodiscard]] int pid() const;
    Said stop(int signal);  // sends the signal, waits for the end, and returns the whole output

  private:
    struct State;
    State* state_;
};

// `text`, a configuration, with backend = "simulated" for every device whose backend it does not name. What is added
// stands behind the rest, or directly below a header that is there.
std::string simulated_beside(std::string text);

// A temporary folder for each test, removed at the end.
class TemporaryFolder {
  public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] std::string operator/(const std::string& name) const { return (path_ / name).string(); }

  private:
    std::filesystem::path path_;
};

// $HORD_DATA, else ../shared/data beside the checkout; empty when neither exists.
std::filesystem::path real_data();

}  // namespace hord::test
