// Inspectors with the pipeline: one pipeline a thread, or one in virtual time.
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware/station/inspector.h"

namespace hord::firmware {
namespace {

std::uint16_t to_register(float lenslets) {
    return static_cast<std::uint16_t>(std::clamp(std::lround(lenslets), 0L, 0xFFFEL));
}

// One thread's pipeline and buffers; no allocation per frame.
struct InspectionWorker {
    algo::Pipeline pipeline;
    std::optional<algo::GridDecoder> decoder;  // of raw frames
    Frame decoded;
};

Judged judge_with(InspectionWorker& bench, std::uint32_t part, const hal::FrameLease& frame,
                  const InspectorSettings& settings) {
    Judged judged;
    judged.part = part;
    judged.failed = true;
    FrameView seen = frame.view();
    if (bench.decoder) {
        if (!bench.decoder->decode(seen, bench.decoded)) return judged;
        seen = bench.decoded.view();
    }
    auto inspection = bench.pipeline.inspect(seen, settings.now);
    judged.failed = !inspection.has_value();
    if (judged.failed) return judged;
    judged.verdict = inspection->verdict;
    judged.reason = inspection->reason;
    judged.defects = static_cast<std::uint16_t>(std::min<std::size_t>(inspection->defects.size(), 0xFFFE));
    judged.score = inspection->score;
    judged.recipe = settings.recipe_number;
    if (!inspection->defects.empty()) {
        judged.position_m = to_register(inspection->defects.front().m);
        judged.position_n = to_register(inspection->defects.front().n);
    }
    if (settings.observer != nullptr) settings.observer->on_inspection(part, seen, *inspection);
    return judged;
}

// shared_ptr, because a std::function must be copyable and a Pipeline is not.
Result<std::shared_ptr<InspectionWorker>> make_bench(const InspectorSettings& settings) {
    auto pipeline = algo::Pipeline::create(settings.extents, settings.bits, settings.recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    auto bench = std::make_shared<InspectionWorker>(InspectionWorker{std::move(*pipeline), std::nullopt, {}});
    if (settings.decoder) {
        bench->decoder = *settings.decoder;
        bench->decoded = bench->decoder->frame(settings.bits);
    }
    return bench;
}

Result<std::vector<InspectFunction>> make_judges(const InspectorSettings& settings) {
    std::vector<InspectFunction> judges;
    for (int k = 0; k < std::max(settings.threads, 1); ++k) {
        auto judge = make_pipeline_judge(settings);
        if (!judge) return tl::unexpected(judge.error());
        judges.push_back(std::move(*judge));
    }
    return judges;
}

}  // namespace

Result<InspectFunction> make_pipeline_judge(const InspectorSettings& settings) {
    auto bench = make_bench(settings);
    if (!bench) return tl::unexpected(bench.error());
    return [bench = *bench, settings](std::uint32_t part, const hal::FrameLease& frame) {
        return judge_with(*bench, part, frame, settings);
    };
}

Result<void> Inspector::do_use(const algo::Recipe&, std::uint16_t) {
    return fail(ErrorCode::unsupported, "this inspector knows no recipes", "use the pipeline");
}

Result<std::unique_ptr<Inspector>> make_threaded_inspector(hal::EventLoop& loop, const InspectorSettings& settings) {
    auto judges = make_judges(settings);
    if (!judges) return tl::unexpected(judges.error());
    const auto remake = [settings](const algo::Recipe& recipe, std::uint16_t number) {
        InspectorSettings other = settings;
        other.recipe = recipe;
        other.recipe_number = number;
        return make_judges(other);
    };
    return make_threaded_inspector(loop, settings.queue, std::move(*judges), remake);
}

Result<std::unique_ptr<Inspector>> make_inline_inspector(hal::EventLoop& loop, const InspectorSettings& settings,
                                                         hal::Duration modelled) {
    auto bench = make_bench(settings);
    if (!bench) return tl::unexpected(bench.error());
    const int threads = std::max(settings.threads, 1);
    // When each of the modelled threads is free again.
    std::vector<hal::TimePoint> free_at(static_cast<std::size_t>(threads));
    auto judge = [bench = *bench, settings, modelled, free_at, &loop](std::uint32_t part,
                                                                      const hal::FrameLease& frame) mutable {
        auto& thread = *std::min_element(free_at.begin(), free_at.end());
        thread = std::max(thread, loop.now()) + modelled;
        return StandInAnswer{judge_with(*bench, part, frame, settings), thread - loop.now()};
    };
    return make_stand_in_inspector(loop, settings.queue + threads, std::move(judge));
}

}  // namespace hord::firmware
