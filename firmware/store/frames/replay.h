// Inspects archived frames again and compares the results with the archived ones, bit for bit. Deterministic: the same
// frames, recipe and software give the same bytes.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "common/result.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::store {

// The archived result of an inspection.
struct Judgement {
    std::string verdict, reason;
    float score = 0;
    Json defects;             // all of them
    std::string maps_sha256;  // of everything behind it
    bool operator==(const Judgement&) const = default;
};

struct Replayed {
    std::string frame;  // the file's name
    std::uint32_t part = 0;
    std::string role, recipe_then, recipe_now;  // names
    Judgement then, now;
    [[nodiscard]] bool same() const { return then == now; }  // to the bit
    [[nodiscard]] bool verdict_changes() const { return then.verdict != now.verdict; }
};

// One JSON object, one line: {"frame":...,"then":{...},"now":{...},"changes":["verdict",...]}. Empty `changes`: equal
// to the bit.
std::string to_json_line(const Replayed& replayed);

class Replay {
  public:
    // With this recipe; without one each frame is inspected with the recipe in its metadata.
    explicit Replay(std::optional<algo::Recipe> recipe = std::nullopt);
    ~Replay();

    // Fails with unreadable (damaged, or no metadata), invalid_argument (the recipe does not fit its light field).
    Result<Replayed> judge(const std::filesystem::path& file);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace hord::firmware::store
