// Signals that end a station, before its event loop watches them: no moment of a start ends by the signal itself.
#pragma once

#include <string_view>

namespace hord::firmware {

// First of all, before main() and threads: SIGINT, SIGTERM, SIGQUIT and SIGHUP wait.
void hold_signals();

// They end the program again, as they do by default: for what is no station.
void release_signals();

// Until a Service watches them, they end the program at once with status 0 and `line` on stderr (a literal; lost if
// stderr does not take it at once). Nothing of a station is open so early. SIGHUP does so, too, if `hangup_ends` and
// nohup does not have it ignored; otherwise it waits for the Service.
void end_at_signals(std::string_view line, bool hangup_ends);

// As nohup leaves SIGHUP.
[[nodiscard]] bool is_ignored(int signal);

}  // namespace hord::firmware
