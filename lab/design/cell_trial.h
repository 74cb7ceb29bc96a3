// Simulated trials of one choice of a cell on small windows of the part: limits from clean windows, then the size of
// each defect that is found with 90 % probability (a90), for every feature set.
//
// A window has the light that the whole part's frame has there (cell_choice.h). Its limits are those that a share
// `false_rejects` of whole good parts would exceed: each window's largest value as Gumbel, extrapolated by the number
// of windows in a part. The trials of all cells use the same places, so that differences are the cells'.
#pragma once

#include <limits>
#include <vector>

#include "lab/design/cell_choice.h"
#include "lab/design/part_values.h"

namespace hord::lab {

constexpr double kNeverFound = std::numeric_limits<double>::infinity();

struct DesignTask {
    sim::Scene part;
    algo::Recipe base;  // form of the part
    std::vector<WantedDefect> defects;
    CameraLimits camera;
    double rate = 10;             // parts a second
    int inspection_threads = 1;   // of the station
    double false_rejects = 1e-3;  // of good parts
    std::uint64_t seed = 1;
    int threads = 0;  // of the simulation
};

// What the part is like, before any camera.
struct PartSurvey {
    sim::Body body;
    double area_mm2 = 0;       // of its single glass
    double largest_slope = 0;  // of its light, rad
    double thickest_mm = 0;    // of its glass, along the light
    bool fills_field = false;  // a web: the field shows no edge of it
    // Fails with invalid_argument for a part without a middle of one solid body, or one that the field's edge cuts.
    static Result<PartSurvey> of(const sim::Scene& part);
    // Whether all within `radius_mm` of the place is single glass whose light is less than 350 mrad steep.
    [[nodiscard]] bool holds(double x_mm, double y_mm, double radius_mm) const;
};

// Places for trials, within the part; the same for the same seed. Fails with invalid_argument when none fits.
struct Place {
    double x_mm = 0, y_mm = 0, turn_rad = 0;
};
Result<std::vector<Place>> draw_places(const PartSurvey& survey, const sim::Scene& part, double radius_mm,
                                       std::size_t count, std::uint64_t seed);

struct FoundSize {
    double a90_mm = kNeverFound;
    double a90_95_mm = kNeverFound;  // with 95 % confidence
    bool at_most = false;            // all trials of the smallest size were found: a90 is this or less
};
struct SetTrial {
    JudgedSet set;
    PartValues limits{};
    std::vector<FoundSize> found;      // of the task's defects
    double time_ms = 0;                // of a part on one core of this machine, from the time of a window
    double worst_ratio = kNeverFound;  // largest a90 over the wanted size
    bool holds_rate = false;           // by that time
    double work = 0;                   // of a part (work_of)
    [[nodiscard]] bool is_enough() const { return holds_rate && worst_ratio <= 1; }
};
// Largest share of a core's time for inspection.
inline constexpr double kUseOfCore = 0.8;
// The work of a verdict on a part, counted, so that other work on the machine does not change a choice. Its unit is the
// reading of a bin; a lenslet takes most, whatever it has of bins (measured by tests/bench/bench_design.cpp).
double work_of(const JudgedSet& set, const algo::Extents& extents);
// Whether `a` is the better choice: it holds the rate, finds all wanted sizes with the most room (differences below a
// tenth do not count), and takes less work.
bool is_better(const SetTrial& a, const SetTrial& b);

struct CellTrial {
    CellChoice cell;
    std::string problem;         // why it was not simulated
    std::vector<SetTrial> sets;  // the best first
};

struct Effort {
    std::size_t clean_windows = 4, places = 2;
    int draws = 2;
};
Result<CellTrial> try_cell(const CellChoice& cell, const DesignTask& task, const PartSurvey& survey,
                           const Effort& effort);

// The sizes that this set finds at other limits, such as those of whole parts.
Result<std::vector<FoundSize>> find_sizes(const CellChoice& cell, const JudgedSet& set, const PartValues& limits,
                                          const DesignTask& task, const PartSurvey& survey, const Effort& effort);
double worst_ratio(const std::vector<FoundSize>& found, const std::vector<WantedDefect>& wanted);

}  // namespace hord::lab
