#include "firmware/service/journal_socket.h"

#include <cstdint>

#include <errno.h>
#include <fmt/format.h>

namespace hord::firmware {
namespace {

void append(std::string& out, std::string_view name, std::string_view value) {
    out += name;
    if (value.find('\n') == std::string_view::npos) {
        out += '=';
    } else {
        out += '\n';
        for (unsigned byte = 0; byte < 8; ++byte)
            out += static_cast<char>((static_cast<std::uint64_t>(value.size()) >> (8 * byte)) & 0xFFU);
    }
    out += value;
    out += '\n';
}

}  // namespace

std::string journal_datagram(const Entry& entry, std::string_view message, std::span<const Field> fields) {
    std::string out;
    if (message.size() <= kMaxMessageBytes) {
        append(out, "MESSAGE", message);
    } else {
        append(out, "MESSAGE",
               fmt::format("{} ... ({} more bytes)", message.substr(0, kMaxMessageBytes),
                           message.size() - kMaxMessageBytes));
    }
    append(out, "MESSAGE_ID", entry.id);
    append(out, "PRIORITY", std::to_string(entry.priority));
    append(out, "SYSLOG_IDENTIFIER", program_invocation_short_name);
    for (const Field& field : fields) append(out, field.name, field.value);
    return out;
}

void JournalSocket::write(const Entry& entry, std::string_view message, std::span<const Field> fields) {
    queue_.flush();
    if (const std::size_t lost = queue_.lost(); lost > 0 && queue_.waiting() + 1 < common::DatagramQueue::kMaxWaiting) {
        queue_.forget_lost();
        const std::string note = fmt::format("{} message{} before this could not be written: the journal took nothing",
                                             lost, lost == 1 ? "" : "s");
        queue_.send(journal_datagram(entry_of(JournalEvent::trouble), note, {}));
    }
    queue_.send(journal_datagram(entry, message, fields));
}

}  // namespace hord::firmware
