// Parts for the simulated cell from a folder of scene files.
#pragma once

#include <filesystem>

#include "hal_sim/cell/production.h"

namespace hord::sim {

// Every *.toml of the folder is a part, in the order of the names. The file's name up to a number at its end is the
// part's kind: bubble-1.toml and bubble-2.toml are bubbles; the kind `good` passes, every other kind is bad. The good
// parts together have the share `good_share` (0..1) of all parts, if there are good and bad ones. Fails with
// not_found (no folder, no scene), invalid_argument (scenes of different cameras) and as load_scene() does.
Result<Production> load_production(const std::filesystem::path& folder, double good_share);

}  // namespace hord::sim
