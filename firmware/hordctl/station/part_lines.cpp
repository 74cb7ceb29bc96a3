#include "firmware/hordctl/station/part_lines.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include <fmt/format.h>

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
    const std::string line = store::to_text(part_json(result, fate, sentence)) + "\n";
    if (std::fputs(line.c_str(), stdout) >= 0 && std::fflush(stdout) == 0) return {};
    lost_ = true;
    const int why = errno;
    const char* const cure = why == EPIPE ? "start its reader and this run again, or read the store"
                                          : "see that its disk has space, or read the store";
    return fail(ErrorCode::io,
                fmt::format("the line of part {} could not be written ({}): inspection goes on, and no further line is "
                            "printed",
                            result.part, std::strerror(why)),
                cure);
}

}  // namespace hord::firmware
