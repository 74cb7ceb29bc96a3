#include "common/cli/progress.h"

#include <algorithm>

#include <fmt/format.h>
#include <unistd.h>

#include "common/cli/message.h"

namespace hord {

Progress::Progress(std::string what, bool quiet)
    : what_(std::move(what)), quiet_(quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
    if (drawn_) print_message("\n");
}

void Progress::show(double done, const std::string& note) {
    if (quiet_) return;
    done = std::clamp(done, 0.0, 1.0);
    if (!terminal_) {
        const int tenths = static_cast<int>(done * 10);
        if (tenths == tenths_) return;
        tenths_ = tenths;
        print_message("{}: {} %{}{}\n", what_, tenths * 10, note.empty() ? "" : ", ", note);
        return;
    }
    const int permille = static_cast<int>(done * 1000);
    if (permille == permille_ && note.empty()) return;
    permille_ = permille;
    constexpr int kWidth = 40;
    const auto full = static_cast<std::size_t>(done * kWidth);
    print_message("\r{} [{}{}] {:3.0f} % {}\033[K", what_, std::string(full, '#'), std::string(kWidth - full, '.'),
                  done * 100, note);
    drawn_ = true;
}

}  // namespace hord
