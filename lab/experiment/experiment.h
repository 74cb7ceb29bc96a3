// The experiments of `hord-lab experiment`. Each answers one question with the simulated cell and algo/. Its results
// are files, a report and claims that hold or do not hold.
//
// To add one: a folder of its own beside this one with a run function, and a row in lab/hord_lab/experiments.cpp.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::lab {

struct ExperimentOptions {
    std::filesystem::path out;     // exists; finished cells in it are used again (result_cache.h)
    std::filesystem::path frames;  // of `reference` a folder of light fields, of `stability` that of the fuzz corpus
    bool quick = false;            // under a minute: fewer or smaller cells, the same claims
    std::uint64_t seed = 1;
    bool tuned_limits = false;  // of the experiment `detection` only: not the recipe's limits, but tuned ones
    int lenslets = 0;           // of `stability` only: times of fields of so many lenslets a side alone; 0: of all
    int threads = 0;            // 0: one a core; results do not depend on it (times measured do)
    std::function<void(double done, const std::string& note)> progress = [](double, const std::string&) {};  // 0..1

    // The options that change the results, as on the command line, each with a space before it.
    [[nodiscard]] std::string arguments() const;
};

// A statement about the method, and the result.
struct Claim {
    std::string text;           // a statement that is true or false
    std::optional<bool> holds;  // empty: undecided, `evidence` says why
    std::string evidence;       // the numbers
    bool expected = true;       // the outcome in docs/results; false: the claim is known not to hold
    [[nodiscard]] bool as_expected() const { return holds == expected; }
};

struct ExperimentReport {
    std::string text;  // the whole report, Markdown
    std::vector<Claim> claims;
    std::vector<std::filesystem::path> files;  // written
    [[nodiscard]] bool as_expected() const;    // every claim was decided and came out as expected
};

struct Experiment {
    std::string_view name;
    std::string_view what;   // one line for --help
    std::string_view takes;  // the measured time of the full form, with the machine
    Result<ExperimentReport> (*run)(const ExperimentOptions& options);
};

// The claims as a Markdown table, with the outcome of each: holds, does not hold, or undecided. Empty for no claims.
std::string describe(std::span<const Claim> claims);

// Fails with io.
Result<void> write_report(const std::filesystem::path& file, const ExperimentReport& report);

}  // namespace hord::lab
