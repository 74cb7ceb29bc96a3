// The journal's native protocol (systemd.io/JOURNAL_NATIVE_PROTOCOL), without waiting for its reader:
// sd_journal_sendv() waits while the journal takes nothing, and the station would stand meanwhile.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "common/datagram_queue.h"
#include "firmware/service/journal.h"

namespace hord::firmware {

inline constexpr std::string_view kJournalSocket = "/run/systemd/journal/socket";

// A longer message is cut: a datagram of this size is below the kernel's limit for one (212992 bytes,
// net.core.wmem_default).
inline constexpr std::size_t kMaxMessageBytes = 65536;

// One entry of the journal. A value of several lines has its length before it.
std::string journal_datagram(const Entry& entry, std::string_view message, std::span<const Field> fields);

// Not thread-safe.
class JournalSocket {
  public:
    explicit JournalSocket(std::string_view address) : queue_(address) {}

    // Keeps what the journal does not take, up to common::DatagramQueue::kMaxWaiting messages; further ones are lost.
    // The next that finds room comes behind a message that says how many were.
    void write(const Entry& entry, std::string_view message, std::span<const Field> fields);
    void flush() { queue_.flush(); }
    void finish(std::chrono::milliseconds patience) { queue_.finish(patience); }

  private:
    common::DatagramQueue queue_;
};

}  // namespace hord::firmware
