#include "firmware/service/journal.h"

#include <array>
#include <chrono>
#include <cstdlib>
#include <iterator>
#include <mutex>
#include <utility>
#include <vector>

#include <errno.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/cli/message.h"
#include "firmware/core/faults.h"
#include "firmware/service/journal_socket.h"

namespace hord::firmware {
namespace {

constexpr std::size_t kEvents = static_cast<std::size_t>(JournalEvent::fault_cleared) + 1;

// In the order of JournalEvent. A released id keeps its meaning.
const Entry kEventEntries[] = {
    {"47eaa0992cb6416d86dc283cf0480ff9", 5, "The HORD station answers",
     "Devices are open and the registers can be read at @HORD_REGISTERS@.", ""},
    {"7c7f3f1cf3f94f4d9ad36eb3bd5b2c55", 4, "Devices of the HORD station are simulated: @HORD_SIMULATED@",
     "The configuration says so. What these devices report is not of the line.",
     "On a real line, name every device in hordd.toml, then restart."},
    {"1509bb0a9bf143318a118783593942a4", 5, "The HORD station went to @HORD_STATE@", "It was in @HORD_FROM@.",
     "In Error: read the fault before this message, look at the line, then reset (hordctl command reset)."},
    {"f5ec52ed0108447592e1bc7656670b14", 4, "Something of the HORD station failed",
     "The message names it and its cure. The station goes on; parts that it could not judge were rejected.",
     "Do what the message says."},
    {"59ba1b0d5c904158a909406c2e416788", 3, "The HORD station cannot start with this configuration",
     "Every problem is in the message, with file and line. The service stays down until it is started again.",
     "Correct the file, check it with hordd --check, then systemctl restart hordd."},
    {"5d32fe61985f44e7aa095ee82bb29976", 5, "The HORD station has read its configuration again",
     "What can change while it runs has changed; the message names what needs a restart.",
     "Restart when the line stands: systemctl restart hordd."},
    {"9a1e40b458154a9999e2d15364c7a500", 4, "The HORD station keeps its old configuration",
     "The new file has problems, or cannot be used now; nothing of it is in use.",
     "Correct what the message names, then systemctl reload hordd."},
    {"68b4aef73eaa4e179d8a4eace693ae2d", 5, "The HORD station judges with another recipe",
     "Number @HORD_RECIPE@, CRC-32 @HORD_RECIPE_CRC@.",
     "If nobody meant that, see who asked for it before this message."},
    {"142c83647806457793e783e7eb04b39b", 5, "The HORD station stopped as asked",
     "Lights are off, the run permit is down.", ""},
    {"3b041641178844f2a60df25453fe2e85", 6, "A fault of the HORD station is over",
     "Fault @HORD_FAULT@. It stays latched until a reset.", ""},
};
static_assert(std::size(kEventEntries) == kEvents);

// The events' entries, then the faults', made once from kFaultTable.
const std::vector<Entry>& all_entries() {
    static const auto entries = [] {
        std::vector<Entry> made(std::begin(kEventEntries), std::end(kEventEntries));
        for (const FaultInfo& fault : kFaultTable) {
            made.push_back({fault.message_id, fault.priority, fmt::format("HORD station fault: {}", fault.name),
                            fault.meaning, fault.cure});
        }
        return made;
    }();
    return entries;
}

std::string capital(std::string_view text) {
    std::string out(text);
    if (!out.empty() && out[0] >= 'a' && out[0] <= 'z') out[0] = static_cast<char>(out[0] - 'a' + 'A');
    return out;
}

// systemd sets JOURNAL_STREAM to device and inode of the stream it connected.
bool stderr_is_the_journal() {
    const char* stream = std::getenv("JOURNAL_STREAM");
    struct stat status {};
    if (stream == nullptr || ::fstat(STDERR_FILENO, &status) != 0) return false;
    return fmt::format("{}:{}", status.st_dev, status.st_ino) == stream;
}

// The program's end waits this long for a journal that takes nothing.
constexpr std::chrono::milliseconds kEndWaits{1000};

struct Journal {
    Journal() = default;
    Journal(const Journal&) = delete;
    Journal& operator=(const Journal&) = delete;
    ~Journal() { socket.finish(kEndWaits); }
    std::mutex mutex;
    JournalSocket socket{kJournalSocket};
};

// Null: stderr is not the journal.
Journal* journal() {
    static const bool to_journal = stderr_is_the_journal();
    if (!to_journal) return nullptr;
    static Journal the_journal;
    return &the_journal;
}

}  // namespace

const Entry& entry_of(JournalEvent what) { return all_entries()[static_cast<std::size_t>(what)]; }
const Entry& entry_of(FaultBit fault) {
    return all_entries()[kEvents + static_cast<std::size_t>(&info_of(fault) - kFaultTable.data())];
}

std::string format_catalog() {
    std::string text = "# What the HORD station's journal messages mean and what to do. Generated: hordd --catalog\n";
    for (const Entry& entry : all_entries()) {
        text += fmt::format("\n-- {}\nSubject: {}\nDefined-By: HORD station\nSupport: man:hordd(8)\n\n{}\n", entry.id,
                            entry.subject, capital(entry.meaning));
        if (!entry.cure.empty()) text += fmt::format("\nWhat to do: {}\n", entry.cure);
    }
    return text;
}

void write_to_journal(const Entry& entry, std::string_view message, std::span<const Field> fields) {
    Journal* const to = journal();
    if (to == nullptr) {
        print_message("{}\n", named_lines(program_invocation_short_name, message));
        return;
    }
    const std::lock_guard lock(to->mutex);
    to->socket.write(entry, message, fields);
}

void flush_journal() {
    Journal* const to = journal();
    if (to == nullptr) return;
    const std::lock_guard lock(to->mutex);
    to->socket.flush();
}

void StationJournal::state(State from, State to, std::uint32_t active) {
    faults(to == State::error ? active : active & reported_);
    write_(entry_of(JournalEvent::state), fmt::format("{} to {}", name_of(from), name_of(to)),
           std::array{Field{"HORD_STATE", std::string(name_of(to))}, Field{"HORD_FROM", std::string(name_of(from))}});
}

void StationJournal::faults(std::uint32_t active, const LineStop& why) {
    const std::uint32_t before = std::exchange(reported_, active);
    if (active == before) return;
    for (const FaultInfo& fault : kFaultTable) {
        const bool is = (active & fault.bit) != 0, was = (before & fault.bit) != 0;
        if (is == was) continue;
        const std::array field{Field{"HORD_FAULT", std::string(fault.name)}};
        if (is) {
            write_(entry_of(fault.bit), "fault " + text_of(fault, why), field);
        } else {
            write_(entry_of(JournalEvent::fault_cleared), fmt::format("fault {} is over", fault.name), field);
        }
    }
}

}  // namespace hord::firmware
