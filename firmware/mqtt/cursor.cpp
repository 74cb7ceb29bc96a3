#include "firmware/mqtt/cursor.h"

#include <cerrno>
#include <fstream>
#include <iterator>

#include <fcntl.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/file.h>

#include "common/crc32.h"
#include "common/file_writing.h"
#include "common/json_integer.h"
#include "common/regular_file.h"

namespace hord::firmware::mqtt {
namespace {

using common::integer_of;
using common::Json;

constexpr std::size_t kLargest = 4096;

std::string text_of(const Cursor& cursor) {
    return Json{{"store", cursor.store},  {"origin", cursor.origin}, {"confirmed", cursor.confirmed},
                {"bdSeq", cursor.bd_seq}, {"lost", cursor.lost},     {"lost_until", cursor.lost_until}}
        .dump();
}

}  // namespace

Result<common::UniqueFd> lock_cursor(const std::filesystem::path& file) {
    common::UniqueFd lock(::open((file.string() + ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
    if (lock && ::flock(lock.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        return fail(ErrorCode::busy, file.string() + " is in use by another hord-mqtt",
                    "end that one, or give each a results.state_file of its own");
    }
    return lock;
}

Result<std::optional<Cursor>> read_cursor(const std::filesystem::path& file) {
    std::error_code error;
    if (!std::filesystem::exists(file, error)) {
        if (error)
            return fail(ErrorCode::io, file.string() + " cannot be read (" + error.message() + ")",
                        "check the folder's owner and the disk");
        return std::optional<Cursor>();
    }
    if (auto regular = common::check_regular(file, "move it away"); !regular) return tl::unexpected(regular.error());
    std::ifstream in(file, std::ios::binary);
    std::string text(kLargest, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(in.gcount()));
    const auto damaged = [&] {
        return fail(ErrorCode::unreadable,
                    file.string() + " is damaged, so it is not known which results were handed over",
                    "move it away: it then begins as results.begin says, and \"all\" sends everything that the store "
                    "still has once more");
    };
    // One line of JSON, one with its CRC-32.
    const auto end = text.find('\n');
    if (end == std::string::npos || text.substr(end + 1) != fmt::format("{:08X}\n", common::crc32(text.substr(0, end))))
        return damaged();
    try {
        const Json json = Json::parse(text.substr(0, end));
        const Cursor cursor{json.at("store").get<std::string>(),
                            integer_of<std::int64_t>(json.at("origin")),
                            integer_of<std::int64_t>(json.at("confirmed")),
                            integer_of<std::uint8_t>(json.at("bdSeq")),
                            integer_of<std::uint64_t>(json.at("lost")),
                            integer_of<std::int64_t>(json.at("lost_until"))};
        if (cursor.origin < 0 || cursor.confirmed < cursor.origin) return damaged();
        return std::optional<Cursor>(cursor);
    } catch (const Json::exception&) {
        return damaged();
    }
}

Result<void> write_cursor(const std::filesystem::path& file, const Cursor& cursor) {
    const std::string text = text_of(cursor);
    return common::write_durably(file, fmt::format("{}\n{:08X}\n", text, common::crc32(text)));
}

}  // namespace hord::firmware::mqtt
