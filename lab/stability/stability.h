// hord-lab experiment stability: are the features correct at the extremes of their input?
//
// A table of cases with expected value (closed form, independent solver or property), result and verdict. Expected
// values are derived here, never taken from algo. The same cases are tests (tests/lab/stability/stability_test.cpp).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/result.h"
#include "lab/experiment/experiment.h"
#include "lab/report/tables.h"

namespace hord::lab {

struct StabilityRow {
    std::string group;  // the extreme: "all zero", "degenerate ties", ...
    std::string name;
    std::string expected, got;
    bool good = false;
};

class StabilityTable {
  public:
    void begin(std::string group) { group_ = std::move(group); }
    // |got - expected| <= tolerance; a NaN or an infinity is wrong.
    void near(const std::string& name, double expected, double got, double tolerance);
    void at_most(const std::string& name, double limit, double got);
    void same(const std::string& name, std::int64_t expected, std::int64_t got);
    void holds(const std::string& name, const std::string& expected, const std::string& got, bool good);

    [[nodiscard]] const std::vector<StabilityRow>& rows() const { return rows_; }
    [[nodiscard]] std::size_t wrong() const;

  private:
    std::string group_;
    std::vector<StabilityRow> rows_;
};

struct StabilityOptions {
    std::uint64_t seed = 1;
    int degenerate_pairs = 1'000'000;                           // against the independent solver
    int random_pairs = 2'000;                                   // for properties
    std::function<void(double done)> progress = [](double) {};  // 0..1
};

// Runs every case.
StabilityTable check_stability(const StabilityOptions& options);

// Its parts: pairs of HORDs, transport problems (against the solver in transport_check.h), and whole frames.
void check_hords(const StabilityOptions& options, StabilityTable& table);
void check_transport(const StabilityOptions& options, StabilityTable& table);
void check_frames(const StabilityOptions& options, StabilityTable& table);

// How long verdicts take, in processor time, for frames with a pedestal, noise, wide spots and many lit bins; 111x111
// lenslets, smaller ones, and 555x555 unless options.quick; options.lenslets: of this size alone. With options.frames,
// the folder of the fuzz corpus, also for its frames. Says where a goal is not reached. Times differ between machines
// and runs, so that they are no claims.
struct VerdictTimes {
    Table sizes;   // the clean frame and the worst one of each size, with the goals
    Table frames;  // every frame, over the clean frame's time
};
Result<VerdictTimes> measure_verdict_times(const ExperimentOptions& options);

// Its parts: the inputs of the fuzz target `verdict` in a field of so many lenslets along each axis, by the default
// recipe and by their own; and the frame files of `frame_file` that have 3x3 lenslets of 3x3 samples or more. Fail with
// not_found, unreadable, and as the decoders do.
Result<void> add_changed_frames(const std::filesystem::path& folder, int lenslets, VerdictTimes& times);
Result<void> add_frame_files(const std::filesystem::path& folder, VerdictTimes& times);

Table table_of(const StabilityTable& cases);

// The experiment: stability.csv and times.csv in options.out, a claim for every extreme, and the times. Fails with io.
Result<ExperimentReport> run_stability(const ExperimentOptions& options);

}  // namespace hord::lab
