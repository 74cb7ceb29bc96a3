// Searches the cell that finds the wanted defects on a part: bins, bin pitch, lenslets, source, light, feature set.
//
// Coarse to fine: a grid of bins and bin pitches; from the three best, one step in each direction (source radius,
// lenslets, bin pitch, light); the best again, at other places and with more trials. Last, the chosen cell judges whole
// parts of another seed (whole_parts.h).
#pragma once

#include <functional>

#include "lab/design/whole_parts.h"

namespace hord::lab {

struct Design {
    std::vector<CellTrial> coarse;  // every cell that was tried or ruled out
    std::vector<CellTrial> fine;    // tried again; the best first: the chosen cell, with its best set
    WholeCheck check;
    double seconds = 0, cpu_seconds = 0;
};

struct DesignOptions {
    bool quick = false;  // fewer cells, trials and parts
    std::function<void(double done, const std::string& note)> progress = [](double, const std::string&) {};
};
// Parts a second at which the written station takes its light's rest and its window of time stamps.
inline constexpr double kHighestRate = 173;

// Fails with invalid_argument for a rate above kHighestRate, for a bubble or an inclusion thicker than the glass, and
// where the form is web and the part does not fill the field, or the other way round.
Result<void> check_task(const DesignTask& task, const PartSurvey& survey);

// The form in which a recipe judges a good part: web where it fills the field, else round, or plate where a good part
// is unfit as a round one and not as a plate in the first cells of the search.
algo::PartForm form_of(DesignTask task, const PartSurvey& survey, const DesignOptions& options);

// Fails as check_task(), with unsupported when good parts are unfit in the first cells (before the search) or no cell
// can show the part, and as the renderer does.
Result<Design> design_cell(const DesignTask& task, const DesignOptions& options);

// Whether a verdict takes at most kUseOfCore of the time between parts.
bool holds_rate(const WholeCheck& check, const DesignTask& task);

// Whether the chosen cell holds the rate, finds every wanted size, and is not seen to miss the aim.
bool meets(const Design& design, const DesignTask& task);

// Whether more good parts than this share are rejected, with 95 % confidence, by those that were counted.
bool misses_aim(const WholeCheck& check, double aim);

// The answer first, then the tables. Markdown.
std::string describe(const Design& design, const DesignTask& task);

// hordd.toml, recipe.toml, and scenes/ with good parts and one of each wanted defect and size, for
// hordctl run --simulate --config FOLDER/hordd.toml. `part_file`: the scene with the part. Returns what was written.
// Fails with io.
Result<std::vector<std::filesystem::path>> write_design(const std::filesystem::path& folder,
                                                        const std::filesystem::path& part_file, const Design& design,
                                                        const DesignTask& task, const PartSurvey& survey);

}  // namespace hord::lab
