// The choices of a cell as axes: bin pitch, lenslets against bins at a fixed number of pixels, bits, frames averaged,
// binned pixels. Each cell looks at the paper's lens through the trials of `hord-lab design` (lab/design/cell_trial.h).
#pragma once

#include <string>
#include <vector>

#include "lab/design/cell_trial.h"
#include "lab/experiment/result_cache.h"

namespace hord::lab {

struct CellPoint {
    std::string axis, label;
    CellChoice cell;
    CameraLimits camera;
};
std::vector<CellPoint> cell_points(bool quick);
// The defects of every trial, with the sizes about which they are tried.
std::vector<WantedDefect> cell_defects();

// {"problem": why the cell cannot show the lens, or "", "sets": by name {"ms": of a part, "a90": [mm or null, ...]}}
Result<Json> try_cell_point(const CellPoint& point, std::uint64_t seed, bool quick, int threads);

// Over the seeds of `found`, one element each: a table for each axis.
struct TriedCell {
    CellPoint point;
    std::vector<Json> found;  // by seed
};
std::string describe_cells(const std::vector<TriedCell>& cells);

}  // namespace hord::lab
