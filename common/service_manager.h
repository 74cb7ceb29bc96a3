// What a program tells the service manager that started it (systemd, $NOTIFY_SOCKET): as sd_notify(), but without
// waiting. Of what the manager does not take at once the newest state of each name is kept, and told later. Nobody is
// told where no manager asks. Main thread alone.
#pragma once

#include <string>

namespace hord::common {

// "READY=1", "STATUS=...", ...; several assignments, one a line, are one state of the first one's name.
void tell_manager(std::string assignments);
// Tells of what is kept what the manager takes now.
void tell_manager_again();

}  // namespace hord::common
