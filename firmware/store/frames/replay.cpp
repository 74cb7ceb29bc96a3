#include "firmware/store/frames/replay.h"

#include <utility>

#include <fmt/format.h>

#include "firmware/diagnostics/verdict_text.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_png.h"

namespace hord::firmware::store {
namespace {

Json changes_of(const Replayed& r) {
    Json changes = Json::array();
    if (r.then.verdict != r.now.verdict) changes.push_back("verdict");
    if (r.then.reason != r.now.reason) changes.push_back("reason");
    if (r.then.out_of_time) return changes;
    if (r.then.score != r.now.score) changes.push_back("score");
    if (r.then.defects != r.now.defects) changes.push_back("defects");
    const bool comparable = r.same_recipe || !r.then.maps_of_bounds;
    if (comparable && r.then.maps_sha256 != r.now.maps_sha256) changes.push_back("maps");
    return changes;
}

}  // namespace

bool Replayed::same() const { return changes_of(*this).empty(); }

std::string to_json_line(const Replayed& r) {
    return to_line({{"frame", r.frame},
                    {"part", r.part},
                    {"role", r.role},
                    {"recipe_then", r.recipe_then},
                    {"recipe_now", r.recipe_now},
                    {"then", to_json(r.then)},
                    {"now", to_json(r.now)},
                    {"explain", r.sentence},
                    {"changes", changes_of(r)}});
}

Result<algo::Inspection> Replay::inspect(const FrameView& frame, const FrameMetadata& metadata,
                                         const std::string& name) {
    const algo::Extents& e = metadata.grid;
    std::string wanted = fmt::format("{}x{} {}x{} {} {} {}", e.m, e.n, e.i, e.j, frame.bits,
                                     metadata.judgement.maps_of_bounds, given_ ? "" : metadata.recipe);
    if (!pipeline_ || known_ != wanted) {
        pipeline_.reset();
        auto recipe = given_ ? Result<algo::Recipe>(*given_) : parse_recipe(metadata.recipe, name);
        if (!recipe) return tl::unexpected(recipe.error());
        auto pipeline = algo::Pipeline::create(
            e, frame.bits, *recipe, 1, metadata.judgement.maps_of_bounds ? algo::MapSet::judged : algo::MapSet::exact);
        if (!pipeline) return tl::unexpected(pipeline.error());
        pipeline_.emplace(std::move(*pipeline));
        recipe_ = std::move(*recipe);
        known_ = std::move(wanted);
    }
    return pipeline_->inspect(frame);
}

Result<Replayed> Replay::judge(const std::filesystem::path& file) {
    auto annotated = read_annotated_frame(file);
    if (!annotated) return tl::unexpected(annotated.error());
    auto metadata = FrameMetadata::from_json(annotated->metadata, file.string());
    if (!metadata) return tl::unexpected(metadata.error());
    const FrameView frame = annotated->frame.view();
    if (digest_of_samples(frame) != metadata->samples_sha256) {
        return fail(ErrorCode::unreadable, file.string() + " holds other samples than were kept",
                    "leave it out; somebody has edited it");
    }
    const auto inspection = inspect(frame, *metadata, file.string());
    if (!inspection) return tl::unexpected(inspection.error());
    const auto then = parse_recipe(metadata->recipe, file.string());
    return Replayed{file.filename().string(),
                    metadata->part,
                    metadata->role,
                    then ? then->name : std::string(),
                    recipe_.name,
                    std::move(metadata->judgement),
                    judgement_of(*inspection),
                    explain(*inspection, recipe_, metadata->grid),
                    !given_};
}

}  // namespace hord::firmware::store
