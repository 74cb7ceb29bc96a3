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

Judged inspect_with(InspectionWorker& worker, std::uint32_t part, const hal::FrameLease& frame,
                    const InspectorSettings& settings) {
    Judged judged;
    judged.part = part;
    judged.failed = true;
    FrameView view = frame.view();
    if (worker.decoder) {
        if (!worker.decoder->decode(view, worker.decoded)) return judged;
        view = worker.decoded.view();
    }
    auto inspection = worker.pipeline.inspect(view, settings.now);
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
    if (settings.observer != nullptr) settings.observer->on_inspection(part, view, *inspection);
    return judged;
}

// shared_ptr, because a std::function must be copyable and a Pipeline is not.
Result<std::shared_ptr<InspectionWorker>> make_worker(const InspectorSettings& settings) {
    auto pipeline = algo::Pipeline::create(settings.extents, settings.bits, settings.recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    auto worker = std::make_shared<InspectionWorker>(InspectionWorker{std::move(*pipeline), std::nullopt, {}});
    if (settings.decoder) {
        worker->decoder = *settings.decoder;
        worker->decoded = worker->decoder->frame(settings.bits);
    }
    return worker;
}

Result<std::vector<InspectFunction>> make_inspect_functions(const InspectorSettings& settings) {
    std::vector<InspectFunction> functions;
    for (int k = 0; k < std::max(settings.threads, 1); ++k) {
        auto inspect = make_pipeline_judge(settings);
        if (!inspect) return tl::unexpected(inspect.error());
        functions.push_back(std::move(*inspect));
    }
    return functions;
}

}  // namespace

Result<InspectFunction> make_pipeline_judge(const InspectorSettings& settings) {
    auto worker = make_worker(settings);
    if (!worker) return tl::unexpected(worker.error());
    return [worker = *worker, settings](std::uint32_t part, const hal::FrameLease& frame) {
        return inspect_with(*worker, part, frame, settings);
    };
}

Result<void> Inspector::do_use(const algo::Recipe&, std::uint16_t) {
    return fail(ErrorCode::unsupported, "this inspector knows no recipes", "use the pipeline");
}

Result<std::unique_ptr<Inspector>> make_threaded_inspector(hal::EventLoop& loop, const InspectorSettings& settings) {
    auto functions = make_inspect_functions(settings);
    if (!functions) return tl::unexpected(functions.error());
    const auto remake = [settings](const algo::Recipe& recipe, std::uint16_t number) {
        InspectorSettings other = settings;
        other.recipe = recipe;
        other.recipe_number = number;
        return make_inspect_functions(other);
    };
    return make_threaded_inspector(loop, settings.queue, std::move(*functions), remake);
}

Result<std::unique_ptr<Inspector>> make_inline_inspector(hal::EventLoop& loop, const InspectorSettings& settings,
                                                         hal::Duration modelled) {
    auto worker = make_worker(settings);
    if (!worker) return tl::unexpected(worker.error());
    const int threads = std::max(settings.threads, 1);
    // When each of the modelled threads is free again.
    std::vector<hal::TimePoint> free_at(static_cast<std::size_t>(threads));
    auto inspect = [worker = *worker, settings, modelled, free_at, &loop](std::uint32_t part,
                                                                          const hal::FrameLease& frame) mutable {
        auto& thread = *std::min_element(free_at.begin(), free_at.end());
        thread = std::max(thread, loop.now()) + modelled;
        return StandInAnswer{inspect_with(*worker, part, frame, settings), thread - loop.now()};
    };
    return make_stand_in_inspector(loop, settings.queue + threads, std::move(inspect));
}

}  // namespace hord::firmware
