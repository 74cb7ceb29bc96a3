#include "tests/system/rig/lamps.h"

#include <fstream>
#include <stdexcept>

#include <fcntl.h>
#include <unistd.h>

namespace hord::rig {
namespace {

// The polling period, since the simulator does not report changes. Each poll wakes the emulated processor, which costs
// the host more than the read itself.
constexpr auto kBetweenLooks = std::chrono::milliseconds(2);

std::string word_of(const std::filesystem::path& file) {
    std::string word;
    std::ifstream(file) >> word;
    return word;
}

int open_or_throw(const std::filesystem::path& file, int flags) {
    const int fd = ::open(file.c_str(), flags | O_CLOEXEC);
    if (fd < 0) throw std::runtime_error(file.string() + " cannot be opened");
    return fd;
}

}  // namespace

std::filesystem::path folder_of_line(const std::filesystem::path& chip, const std::string& name) {
    for (int k = 0;; ++k) {
        const std::string number = std::to_string(k);
        const auto line = chip / "bank0" / ("line" + number);
        if (!std::filesystem::exists(line)) throw std::runtime_error(chip.string() + " has no line " + name);
        if (word_of(line / "name") != name) continue;
        return std::filesystem::path("/sys/devices/platform") / word_of(chip / "dev_name") /
            word_of(chip / "bank0" / "chip_name") / ("sim_gpio" + number);
    }
}

DrivenLine::DrivenLine(const std::filesystem::path& chip, const std::string& name)
    : fd_(open_or_throw(folder_of_line(chip, name) / "pull", O_WRONLY)) {}
DrivenLine::~DrivenLine() { close(fd_); }
void DrivenLine::drive(bool high) {
    const std::string_view pull = high ? "pull-up" : "pull-down";
    if (pwrite(fd_, pull.data(), pull.size(), 0) < 0)
        throw std::runtime_error("the light barrier's line cannot be driven");
}

LampWatch::LampWatch(const hal::Clock& clock, const std::filesystem::path& chip, const std::vector<std::string>& lines,
                     Told told) {
    for (const std::string& line : lines) fds_.push_back(open_or_throw(folder_of_line(chip, line) / "value", O_RDONLY));
    thread_ = std::thread([this, &clock, told = std::move(told)] {
        std::uint32_t known = 0;
        while (!stopping_) {
            std::uint32_t lit = 0;
            for (std::size_t k = 0; k < fds_.size(); ++k) {
                char value = '0';
                if (pread(fds_[k], &value, 1, 0) == 1 && value == '1') lit |= 1U << k;
            }
            if (lit != known) told(known = lit, clock.now());
            std::this_thread::sleep_for(kBetweenLooks);
        }
    });
}

LampWatch::~LampWatch() {
    stopping_ = true;
    thread_.join();
    for (const int fd : fds_) close(fd);
}

}  // namespace hord::rig
