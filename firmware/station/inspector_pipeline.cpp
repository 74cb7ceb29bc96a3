// Inspectors with the pipeline, one a thread.
#include <algorithm>
#include <cmath>
#include <vector>

#include "firmware/station/inspector.h"

namespace hord::firmware {
namespace {

std::uint16_t to_register(float lenslets) {
    return static_cast<std::uint16_t>(std::clamp(std::lround(lenslets), 0L, 0xFFFEL));
}

// No allocation per frame.
Judged inspect_with(algo::Pipeline& pipeline, std::uint32_t part, const hal::FrameLease& frame,
                    const InspectorSettings& settings) {
    Judged judged;
    judged.part = part;
    judged.failed = true;
    auto inspection = pipeline.inspect(frame.view(), settings.now, settings.limits);
    judged.failed = !inspection.has_value();
    if (judged.failed) return judged;
    judged.verdict = inspection->verdict;
    judged.reason = inspection->reason;
    judged.defects = static_cast<std::uint16_t>(std::min<std::size_t>(inspection->defects.size(), 0xFFFE));
    judged.score = inspection->score;
    judged.bounded = inspection->bounded;
    judged.recipe = settings.recipe_number;
    if (!inspection->defects.empty()) {
        judged.position_m = to_register(inspection->defects.front().m);
        judged.position_n = to_register(inspection->defects.front().n);
    }
    if (settings.observer != nullptr) settings.observer->on_inspection(part, inspection->macro_pixels, *inspection);
    return judged;
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
    auto pipeline = settings.decoder ? algo::Pipeline::create(*settings.decoder, settings.bits, settings.recipe)
                                     : algo::Pipeline::create(settings.extents, settings.bits, settings.recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    // shared_ptr, because a std::function must be copyable and a Pipeline is not.
    auto shared = std::make_shared<algo::Pipeline>(std::move(*pipeline));
    return [shared, settings](std::uint32_t part, const hal::FrameLease& frame) {
        return inspect_with(*shared, part, frame, settings);
    };
}

Result<void> Inspector::use(const algo::Recipe&, std::uint16_t) {
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

}  // namespace hord::firmware
