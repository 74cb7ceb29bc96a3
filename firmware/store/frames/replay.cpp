#include "firmware/store/frames/replay.h"

#include <algorithm>
#include <map>
#include <utility>

#include <fmt/format.h>

#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/frames/frame_retention.h"
#include "firmware/store/results/records.h"

namespace hord::firmware::store {
namespace {

// Archived defects with their numbers as floats, as the inspection gave them.
Json defects_in(const Json& archived) {
    Json list = Json::array();
    for (const Json& d : archived) {
        list.push_back({{"m", d.at("m").get<float>()},
                        {"n", d.at("n").get<float>()},
                        {"area", d.at("area").get<std::uint32_t>()},
                        {"peak", d.at("peak").get<float>()},
                        {"kind", d.at("kind").get<std::string>()}});
    }
    return list;
}

Json to_json(const Judgement& j) {
    return {{"verdict", j.verdict},
            {"reason", j.reason},
            {"score", j.score},
            {"defects", j.defects},
            {"maps_sha256", j.maps_sha256}};
}

struct Archived {
    Replayed replayed;
    algo::Extents extents;
    std::string recipe, samples_sha256;
};

// Throws Json::exception; the caller catches it.
Archived read_metadata(const std::string& metadata) {
    const Json json = Json::parse(metadata);
    Archived archived;
    archived.replayed.part = json.at("part").get<std::uint32_t>();
    archived.replayed.role = json.at("role").get<std::string>();
    Judgement& then = archived.replayed.then;
    then.verdict = json.at("verdict").get<std::string>();
    then.reason = algo::present_reason_name(json.at("reason").get<std::string>());
    then.score = json.at("score").get<float>();
    then.defects = defects_in(json.at("defects"));
    then.maps_sha256 = json.at("maps_sha256").get<std::string>();
    const Json& grid = json.at("grid");
    archived.extents = {grid.at("m").get<int>(), grid.at("n").get<int>(), grid.at("i").get<int>(),
                        grid.at("j").get<int>()};
    archived.recipe = json.at("recipe").get<std::string>();
    archived.samples_sha256 = json.at("samples_sha256").get<std::string>();
    return archived;
}

}  // namespace

std::string to_json_line(const Replayed& r) {
    Json changes = Json::array();
    if (r.then.verdict != r.now.verdict) changes.push_back("verdict");
    if (r.then.reason != r.now.reason) changes.push_back("reason");
    if (r.then.score != r.now.score) changes.push_back("score");
    if (r.then.defects != r.now.defects) changes.push_back("defects");
    if (r.then.maps_sha256 != r.now.maps_sha256) changes.push_back("maps");
    return to_line({{"frame", r.frame},
                    {"part", r.part},
                    {"role", r.role},
                    {"recipe_then", r.recipe_then},
                    {"recipe_now", r.recipe_now},
                    {"then", to_json(r.then)},
                    {"now", to_json(r.now)},
                    {"changes", std::move(changes)}});
}

struct Replay::Parts {
    std::optional<algo::Recipe> recipe;
    // The pipeline of the last frame is reused while recipe and extents stay the same.
    std::string known;  // recipe text and extents that `pipeline` was made for
    std::string known_name;
    std::optional<algo::Pipeline> pipeline;
};

Replay::Replay(std::optional<algo::Recipe> recipe) : parts_(std::make_unique<Parts>()) {
    parts_->recipe = std::move(recipe);
}
Replay::~Replay() = default;

Result<Replayed> Replay::judge(const std::filesystem::path& file) {
    auto annotated = read_annotated_frame(file);
    if (!annotated) return tl::unexpected(annotated.error());
    Archived archived;
    try {
        archived = read_metadata(annotated->metadata);
    } catch (const Json::exception& error) {
        return fail(ErrorCode::unreadable, file.string() + " has metadata that cannot be read (" + error.what() + ")",
                    "name frames that a station has kept");
    }
    const FrameView frame = annotated->frame.view();
    if (digest_of_samples(frame) != archived.samples_sha256) {
        return fail(ErrorCode::unreadable, file.string() + " holds other samples than were kept",
                    "leave it out; somebody has edited it");
    }
    Replayed& replayed = archived.replayed;
    replayed.frame = file.filename().string();

    const algo::Extents& e = archived.extents;
    const auto then = parse_recipe(archived.recipe, file.string());
    if (then) replayed.recipe_then = then->name;
    const std::string wanted = fmt::format("{}x{} {}x{} {} {}", e.m, e.n, e.i, e.j, frame.bits,
                                           parts_->recipe ? std::string() : archived.recipe);
    if (!parts_->pipeline || parts_->known != wanted) {
        if (!parts_->recipe && !then) return tl::unexpected(then.error());
        const algo::Recipe& recipe = parts_->recipe ? *parts_->recipe : *then;
        auto pipeline = algo::Pipeline::create(e, frame.bits, recipe);
        if (!pipeline) return tl::unexpected(pipeline.error());
        parts_->pipeline.emplace(std::move(*pipeline));
        parts_->known = wanted;
        parts_->known_name = recipe.name;
    }
    replayed.recipe_now = parts_->known_name;
    const auto inspection = parts_->pipeline->inspect(frame);
    if (!inspection) return tl::unexpected(inspection.error());
    replayed.now = {std::string(algo::name_of(inspection->verdict)), std::string(algo::name_of(inspection->reason)),
                    inspection->score, store::to_json(inspection->defects), digest_of_maps(*inspection)};
    return std::move(replayed);
}

}  // namespace hord::firmware::store
