#include "firmware/hordctl/station/part_lines.h"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include "firmware/diagnostics/verdict_text.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware {
namespace {

// `sentence`: empty for a part without inspection.
store::Json part_json(const PartResult& result, const Backends::Fate& fate, const std::string& sentence) {
    using store::Json;
    Json json{{"part", result.part},
              {"verdict", name_of(result.verdict)},
              {"reason", name_of(result.reason)},
              {"score", result.score},
              {"defects", result.defects},
              {"latency_us", result.latency_us},
              {"reject", name_of(result.reject)},
              {"reject_latency_us", result.reject_latency_us}};
    if (result.bounded) json["bounded"] = true;
    if (!sentence.empty()) json["explain"] = sentence;
    if (!fate.kind.empty()) json["truth"] = fate.kind;
    json["ejected"] = fate.ejected ? Json(*fate.ejected) : Json(nullptr);
    if (fate.taken_off) json["taken_off"] = true;
    if (fate.on_line) json["on_line"] = true;
    return json;
}

tl::unexpected<Error> not_written(std::uint32_t part, const std::string& why, const std::string& cure) {
    return fail(ErrorCode::io,
                fmt::format("the line of part {} could not be written ({}): inspection goes on, and no further line is "
                            "printed",
                            part, why),
                cure);
}

}  // namespace

void PartLines::set_recipe(std::shared_ptr<const algo::Recipe> recipe) {
    const std::lock_guard lock(mutex_);
    recipe_ = std::move(recipe);
}

void PartLines::keep(std::uint32_t part, const algo::Inspection& found, const algo::Extents& extents) {
    const std::lock_guard lock(mutex_);
    while (by_part_.size() >= kMax) by_part_.erase(by_part_.begin());
    by_part_[part] = explain(found, *recipe_, extents);
}

std::string PartLines::take(std::uint32_t part) {
    const std::lock_guard lock(mutex_);
    const auto found = by_part_.extract(part);
    return found.empty() ? std::string() : std::move(found.mapped());
}

Result<void> PartLines::print(const PartResult& result, const Backends::Fate& fate) {
    const std::string sentence = take(result.part);
    if (lost_) return {};
    if (waiting_.size() > kMaxWaiting) {
        lost_ = true;  // what waits is whole lines: the end may still bring them
        return not_written(result.part, "its reader does not take it", "let the reader go on, or read the store");
    }
    waiting_ += store::to_text(part_json(result, fate, sentence)) + "\n";
    return write(result.part, 0);
}

Result<void> PartLines::finish(int patience_ms) {
    if (auto done = write(0, patience_ms); !done) return done;
    if (waiting_.empty() || std::exchange(lost_, true)) return {};
    return fail(ErrorCode::io, "the last lines could not be written: their reader does not take them",
                "let the reader go on, or read the store");
}

// A pipe that can be written takes so many bytes without waiting (PIPE_BUF); a file or a terminal does anyway.
Result<void> PartLines::write(std::uint32_t part, int patience_ms) {
    std::size_t done = 0;
    int why = 0;
    while (why == 0 && done < waiting_.size()) {
        pollfd ready{STDOUT_FILENO, POLLOUT, 0};
        if (::poll(&ready, 1, patience_ms) == 0) break;
        const ssize_t count =
            ::write(STDOUT_FILENO, waiting_.data() + done, std::min<std::size_t>(waiting_.size() - done, PIPE_BUF));
        if (count >= 0) done += static_cast<std::size_t>(count);
        else if (errno != EINTR && errno != EAGAIN) why = errno;
    }
    waiting_.erase(0, done);
    if (why == 0) return {};
    waiting_.clear();
    if (std::exchange(lost_, true)) return {};
    return not_written(part, std::strerror(why),
                       why == EPIPE ? "start its reader and this run again, or read the store"
                                    : "see that its disk has space, or read the store");
}

}  // namespace hord::firmware
