// The pipeline as an inspector: one a thread, or one in virtual time.
#include <algorithm>
#include <vector>

#include "firmware/inspector.h"

namespace hord::firmware {
namespace {

Judged judge_with(algo::Pipeline& pipeline, std::uint32_t part, const hal::FrameLease& frame, const InspectorSettings& settings) {
    Judged judged;
    judged.part = part;
    auto inspection = pipeline.inspect(frame.view(), settings.now);
    judged.failed = !inspection.has_value();
    if (judged.failed) return judged;
    judged.verdict = inspection->verdict;
    judged.reason = inspection->reason;
    judged.defects = static_cast<std::uint16_t>(std::min<std::size_t>(inspection->defects.size(), 0xFFFE));
    judged.score = inspection->score;
    if (settings.observer != nullptr) settings.observer->on_inspection(part, frame.view(), *inspection);
    return judged;
}

// std::function wants what can be copied; a Pipeline cannot.
Result<std::shared_ptr<algo::Pipeline>> make_pipeline(const InspectorSettings& settings) {
    auto pipeline = algo::Pipeline::create(settings.extents, settings.bits, settings.recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    return std::make_shared<algo::Pipeline>(std::move(*pipeline));
}

}  // namespace

Result<std::unique_ptr<Inspector>> make_threaded_inspector(hal::EventLoop& loop, const InspectorSettings& settings) {
    std::vector<Judge> judges;
    for (int k = 0; k < std::max(settings.threads, 1); ++k) {
        auto pipeline = make_pipeline(settings);
        if (!pipeline) return tl::unexpected(pipeline.error());
        judges.emplace_back([pipeline = *pipeline, settings](std::uint32_t part, const hal::FrameLease& frame) {
            return judge_with(*pipeline, part, frame, settings);
        });
    }
    return make_threaded_inspector(loop, settings.queue, std::move(judges));
}

Result<std::unique_ptr<Inspector>> make_inline_inspector(hal::EventLoop& loop, const InspectorSettings& settings,
                                                         hal::Duration modelled) {
    auto pipeline = make_pipeline(settings);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const int threads = std::max(settings.threads, 1);
    // When each of the modelled threads is free again.
    std::vector<hal::TimePoint> free_at(static_cast<std::size_t>(threads));
    auto judge = [pipeline = *pipeline, settings, modelled, free_at, &loop](std::uint32_t part, const hal::FrameLease& frame) mutable {
        auto& thread = *std::min_element(free_at.begin(), free_at.end());
        thread = std::max(thread, loop.now()) + modelled;
        return StandInAnswer{judge_with(*pipeline, part, frame, settings), thread - loop.now()};
    };
    return make_stand_in_inspector(loop, settings.queue + threads, std::move(judge));
}

}  // namespace hord::firmware
