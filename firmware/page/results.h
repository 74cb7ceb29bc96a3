// Queries of the page to the store: results by filters, page by page; one part's record; changes. Each query opens the
// store read-only and is limited in time and rows. Any thread; one query at a time.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "algo/verdict/verdict.h"
#include "common/result.h"
#include "firmware/page/fair_mutex.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::page {

// A part in an address: the number of its result in the store ("4711"), or the station's start and the part's number
// since then ("0a1b2c3d-42").
struct PartKey {
    std::optional<std::int64_t> number;
    std::uint32_t boot = 0, part = 0;
};
std::optional<PartKey> parse_part_key(std::string_view text);

// The kinds of defects that results may be searched by.
inline constexpr algo::DefectKind kDefectKinds[] = {algo::DefectKind::scattering, algo::DefectKind::absorbing,
                                                    algo::DefectKind::surface, algo::DefectKind::scratch,
                                                    algo::DefectKind::unknown};

// The filters of search() and csv().
inline constexpr std::string_view kFilters[] = {"verdict", "reason", "kind",   "recipe", "part",
                                                "since",   "until",  "before", "limit"};

using Fields = std::multimap<std::string, std::string>;  // the decoded query of an address

class Results {
  public:
    static constexpr std::int64_t kMaxRows = 200;

    explicit Results(std::filesystem::path folder) : folder_(std::move(folder)) {}

    // verdict, reason, kind, recipe, part, since, until (as `hordctl results`), before (a number: older ones), limit.
    // {"rows":[newest first],"more":true}. Fails with invalid_argument, naming the field and its valid values;
    // not_found, timeout, busy, and as the store.
    Result<store::Json> search(const Fields& fields);

    // The same filters, as CSV, the newest rows, oldest first; limit: 1 to kMaxCsvRows, which is the default.
    static constexpr std::int64_t kMaxCsvRows = 10'000;
    Result<std::string> csv(const Fields& fields);

    // Counts for yield and Pareto charts of the last 24 hours in quarters of an hour, or of the last week in hours:
    // {"step_s","rows":[[start_s,recipe,verdict,reason,parts],...],"kinds":[[start_s,recipe,kind,parts],...]}.
    Result<store::Json> counts(bool week);

    // Scores in units of their limit, of the last 24 hours in steps of 5 minutes, or of the last 15 minutes in steps of
    // 5 s: {"step_s","fields":["passed_mean",...],"rows":[[start_s,value or null,...],...]}, as Live::history_json.
    Result<store::Json> scores(bool day);

    // Fails with not_found.
    Result<store::StoredResult> one(const PartKey& key);

    // The newest recipe of the store and who set it: {"name","time","peer","text"}.
    Result<store::Json> recipe_in_use();

    // The newest changes and commands: {"rows":[newest first]}.
    Result<store::Json> changes(std::int64_t most);

  private:
    Result<std::unique_ptr<store::StoreReader>> open();
    template <class Row>
    using Each = Result<void> (store::StoreReader::*)(const store::ResultFilter&,
                                                      const std::function<void(const Row&)>&);
    // The rows that the store's `each` finds.
    template <class Row>
    Result<std::vector<Row>> read(const store::ResultFilter& filter, Each<Row> each);

    // Nothing was found: fails with invalid_argument, naming the recipes, if no recipe of the store has this name.
    Result<void> refuse_unknown_recipe(const std::string& name);

    // {"step_s"} and what `fill` adds to it of the last `span`, by periods of `step`.
    using Fill =
        std::function<Result<void>(store::StoreReader&, store::UtcMicros since, store::UtcMicros until, store::Json&)>;
    Result<store::Json> by_period(std::chrono::seconds span, std::chrono::seconds step, const Fill& fill);

    const std::filesystem::path folder_;
    FairMutex mutex_;
};

// A tar archive is, for each member, a header of 512 bytes, its bytes and zeros up to 512; then two blocks of zeros.
constexpr std::size_t kTarBlock = 512;
// `name`: at most 99 characters.
std::string tar_header(const std::string& name, std::size_t size, std::int64_t time_s);
std::string tar_padding(std::size_t size);

}  // namespace hord::firmware::page
