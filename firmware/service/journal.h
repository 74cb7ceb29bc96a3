// What the service tells the journal: a message a person can read, an id that names what happened, and fields a program
// can filter by. `journalctl -x` shows the catalogue's entry of the id: what it means and what to do.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/core/station_types.h"

namespace hord::firmware {

enum class JournalEvent {
    ready,                  // the service answers
    state,                  // the state machine went somewhere
    trouble,                // a device, a file or a request failed; the message has the cure
    configuration_refused,  // at start: the service ends
    reloaded,               // what can be changed without a restart has been
    reload_refused,         // the old configuration stays
    recipe,                 // another recipe is in use
    stopped,                // as asked
    fault_cleared,
};

struct Entry {
    std::string_view id;       // MESSAGE_ID, 32 hexadecimal digits
    int priority = 6;          // as in syslog: 2 critical, 3 error, 4 warning, 5 notice, 6 information
    std::string_view subject;  // of the catalogue's entry
    std::string_view meaning;  // and its text
    std::string_view cure;
};

// Every happening, and every fault of firmware/core/faults.h, has one of its own.
const Entry& entry_of(JournalEvent what);
const Entry& entry_of(FaultBit fault);
std::span<const Entry> journal_entries();

// The catalogue file: `hordd --catalog > deploy/hord.catalog`; a test compares.
std::string format_catalog();

struct Field {
    std::string_view name;  // "HORD_STATE"
    std::string value;
};

// What is sent to the journal for it, "NAME=value" each.
std::vector<std::string> journal_fields(const Entry& entry, std::string_view message, std::span<const Field> fields);

// To the journal when this process's stderr leads there, else to stderr as one line.
void tell(const Entry& entry, std::string_view message, std::span<const Field> fields = {});

// What a station goes through, entry by entry: where its state machine went, and each fault when it comes and when it
// is over.
class JournalStory {
  public:
    using Tell = std::function<void(const Entry& entry, std::string_view message, std::span<const Field> fields)>;
    explicit JournalStory(Tell to) : tell_(std::move(to)) {}

    // `active`: FaultBits as they are then. They are told first, so that Error stands behind its cause.
    void state(State from, State to, std::uint32_t active);
    void faults(std::uint32_t active);  // those that have come or gone since

  private:
    Tell tell_;
    std::uint32_t told_ = 0;
};

}  // namespace hord::firmware
