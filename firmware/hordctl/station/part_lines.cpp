#include "firmware/hordctl/station/part_lines.h"

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <utility>

#include <fmt/format.h>

#include "common/cli/output.h"
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

tl::unexpected<Error> not_written(std::uint32_t first, const std::string& why, const char* then, const char* cure) {
    return fail(ErrorCode::io, fmt::format("the lines from part {} on could not be written ({}){}", first, why, then),
                cure);
}

constexpr const char* kGoesOn = ": inspection goes on, and no further line is printed";

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
        return not_written(result.part, "its reader does not take them", kGoesOn,
                           "let the reader go on, or read the store");
    }
    waiting_ += store::to_text(part_json(result, fate, sentence)) + "\n";
    waiting_parts_.push_back(result.part);
    return write(0, kGoesOn);
}

Result<void> PartLines::finish(int patience_ms) {
    if (auto done = write(patience_ms, ""); !done) return done;
    if (waiting_.empty() || std::exchange(lost_, true)) return {};
    return not_written(waiting_parts_.front(), "their reader does not take them", "",
                       "let the reader go on, or read the store");
}

Result<void> PartLines::write(int patience_ms, const char* then) {
    const Written written = write_output(waiting_, patience_ms);
    for (auto ended = std::count(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(written.bytes), '\n');
         ended > 0; --ended)
        waiting_parts_.pop_front();
    waiting_.erase(0, written.bytes);
    if (written.reason == 0) return {};
    waiting_.clear();
    if (std::exchange(lost_, true)) return {};
    return not_written(waiting_parts_.front(), std::strerror(written.reason), then,
                       written.reason == EPIPE ? "start its reader and this run again, or read the store"
                                               : "see that its disk has space, or read the store");
}

}  // namespace hord::firmware
