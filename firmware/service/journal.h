// Messages to the systemd journal: a text for people, a message id, and fields to filter by. `journalctl -x` shows the
// catalogue's explanation and cure for the id.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "firmware/core/faults.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

enum class JournalEvent {
    ready,                  // the registers can be read
    simulated,              // at start: some devices are not real
    state,                  // change of state
    trouble,                // a device, a file or a request failed; the message has the cure
    configuration_refused,  // at start: the service ends
    reloaded,               // the configuration was read again
    reload_refused,         // the old configuration stays
    recipe,                 // another recipe is in use
    stopped,                // on request
    fault_cleared,
};

struct Entry {
    std::string_view id;       // MESSAGE_ID, 32 hexadecimal digits
    int priority = 6;          // as in syslog: 2 critical, 3 error, 4 warning, 5 notice, 6 information
    std::string subject;       // of the catalogue's entry
    std::string_view meaning;  // its text
    std::string_view cure;
};

// One entry for each JournalEvent and for each fault of firmware/core/faults.h.
const Entry& entry_of(JournalEvent what);
const Entry& entry_of(FaultBit fault);

// The catalogue file: `hordd --catalog > deploy/hord.catalog`; a test compares.
std::string format_catalog();

struct Field {
    std::string_view name;  // "HORD_STATE"
    std::string value;
};

// Any thread. Writes to the journal if stderr is connected to it, else to stderr as one line. Does not wait for the
// journal: what it does not take is kept (journal_socket.h), and the end of the program waits at most 1 s for it.
void write_to_journal(const Entry& entry, std::string_view message, std::span<const Field> fields = {});
inline void write_to_journal(JournalEvent what, std::string_view message, std::span<const Field> fields = {}) {
    write_to_journal(entry_of(what), message, fields);
}
// Any thread. Hands over what the journal did not take before; to be called from time to time.
void flush_journal();

// Writes a station's changes of state, and each fault when it comes and when it is over.
class StationJournal {
  public:
    using Write = std::function<void(const Entry& entry, std::string_view message, std::span<const Field> fields)>;
    explicit StationJournal(Write to) : write_(std::move(to)) {}

    // `active`: the FaultBits at that time. Those that are over are written first, and before Error those that came,
    // too. In other states devices may just be opening: faults() tells of them when they stay away.
    void state(State from, State to, std::uint32_t active);
    // Writes those that came or went since the last call. `why`: of the line stop, if there is one.
    void faults(std::uint32_t active, const LineStop& why = {});
    // Writes those that were not told before; they may be over before faults() is called next.
    void raised(std::uint32_t bits, const LineStop& why) { faults(reported_ | bits, why); }

  private:
    Write write_;
    std::uint32_t reported_ = 0;
};

}  // namespace hord::firmware
