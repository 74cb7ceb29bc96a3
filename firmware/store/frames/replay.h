// Inspects archived frames again and compares the results with the archived ones, bit for bit. Deterministic: the same
// frames, recipe and software give the same bytes.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>

#include "algo/inspection/pipeline.h"
#include "common/result.h"
#include "firmware/store/frames/frame_metadata.h"

namespace hord::firmware::store {

struct Replayed {
    std::string frame;  // the file's name
    std::uint32_t part = 0;
    std::string role, recipe_then, recipe_now;  // names
    Judgement then, now;
    std::string sentence;     // the verdict of now in words (firmware/diagnostics/verdict_text.h)
    bool same_recipe = true;  // of the frame's metadata. Another one solves other gradients: maps of bounds differ
    // Bit for bit. Not compared: maps, score and defects of an inspection whose time had run out
    // (Judgement::out_of_time), and maps of bounds by another recipe.
    [[nodiscard]] bool same() const;
    [[nodiscard]] bool verdict_changes() const { return then.verdict != now.verdict; }
};

// One JSON object, one line: {"frame":...,"then":{...},"now":{...},"changes":["verdict",...]}. Empty `changes`: equal
// to the bit.
std::string to_json_line(const Replayed& replayed);

class Replay {
  public:
    // With this recipe; without one each frame is inspected with the recipe in its metadata.
    explicit Replay(std::optional<algo::Recipe> recipe = std::nullopt) : given_(std::move(recipe)) {}

    // Fails with unreadable (damaged, or no metadata), invalid_argument (the recipe does not fit its light field).
    Result<Replayed> judge(const std::filesystem::path& file);

    // The inspection of a frame that was read already, valid until the next one. `name`: for messages.
    Result<algo::Inspection> inspect(const FrameView& frame, const FrameMetadata& metadata, const std::string& name);
    [[nodiscard]] const algo::Recipe& recipe() const { return recipe_; }  // of the last inspection

  private:
    const std::optional<algo::Recipe> given_;
    // The pipeline of the last frame is reused while recipe and extents stay the same.
    std::string known_;  // recipe text and extents that `pipeline_` was made for
    algo::Recipe recipe_;
    std::optional<algo::Pipeline> pipeline_;
};

}  // namespace hord::firmware::store
