#include "firmware/store/results/store_reader.h"

#include <array>
#include <limits>

#include <fmt/format.h>

#include "firmware/store/results/database.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/schema.h"
#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware::store {
namespace {

// A WHERE clause that grows.
class Conditions {
  public:
    void add(const std::string& condition, Value value) {
        values_.push_back(std::move(value));
        sql_ += (sql_.empty() ? "WHERE " : " AND ") + condition + "?" + std::to_string(values_.size());
        if (condition.find('(') != std::string::npos) sql_ += ")";
    }
    [[nodiscard]] const std::string& sql() const { return sql_; }
    [[nodiscard]] const std::vector<Value>& values() const { return values_; }

  private:
    std::string sql_;
    std::vector<Value> values_;
};

// The newest `count` of what `inner` selects, by number, in ascending order again.
std::string newest_of(const std::string& inner, std::optional<std::int64_t> count) {
    if (!count) return inner + " ORDER BY number";
    return "SELECT * FROM (" + inner + " ORDER BY number DESC LIMIT " + std::to_string(*count) + ") ORDER BY number";
}

void add_times(Conditions& where, const ResultFilter& filter) {
    if (filter.since) where.add("time_us >= ", *filter.since);
    if (filter.until) where.add("time_us < ", *filter.until);
    if (filter.run) where.add("run = ", *filter.run);
}

}  // namespace

void StoreReader::limit_time(std::chrono::milliseconds most) { database_->limit_time(most); }

Result<std::unique_ptr<StoreReader>> StoreReader::open(const std::filesystem::path& folder) {
    auto database = Database::open(folder / kStoreFile, Database::Access::read);
    if (!database) return tl::unexpected(database.error());
    auto age = check_schema(**database);
    if (!age && age.error().code == ErrorCode::io) {
        // No writer, and no permission to create the -wal and -shm files that a reader of a log needs: there is no log
        // to read.
        std::error_code none;
        const auto log = std::filesystem::file_size((folder / kStoreFile).string() + "-wal", none);
        if (none || log == 0) {
            database = Database::open(folder / kStoreFile, Database::Access::read_at_rest);
            if (!database) return tl::unexpected(database.error());
            age = check_schema(**database);
        }
    }
    if (!age) return tl::unexpected(age.error());
    if (*age == Age::empty)
        return fail(ErrorCode::unreadable, (*database)->file().string() + " is empty",
                    "start its station, which begins a new store in it; if it had results before, see the disk, and "
                    "put a backup in its place");
    if (*age == Age::older) {
        return fail(ErrorCode::unsupported, (*database)->file().string() + " was written by older software",
                    "start the station once: it brings the store up to date");
    }
    auto id = read_store_id(**database);
    if (!id) return tl::unexpected(id.error());
    return std::unique_ptr<StoreReader>(new StoreReader(std::move(*database), std::move(*id)));
}

StoreReader::StoreReader(std::unique_ptr<Database> database, std::string id)
    : database_(std::move(database)), id_(std::move(id)) {}
StoreReader::~StoreReader() = default;

// From the head, which has it even when retention has removed every row.
Result<std::int64_t> StoreReader::newest_number() {
    return database_->get_integer(
        "SELECT max(coalesce((SELECT number FROM heads WHERE chain = 'results'), 0), coalesce((SELECT max(number) FROM "
        "results), 0))");
}

Result<void> StoreReader::each_result(const ResultFilter& filter,
                                      const std::function<void(const StoredResult&)>& take) {
    Conditions where;
    add_times(where, filter);
    if (filter.number) where.add("number = ", *filter.number);
    if (filter.before) where.add("number < ", *filter.before);
    if (filter.boot)
        where.add(
            "run IN (SELECT number FROM changes WHERE what = 'start' AND json_extract(iif(json_valid(after), after, "
            "'{}'), '$.boot') = ",
            std::int64_t{*filter.boot});
    if (filter.part) where.add("part = ", std::int64_t{*filter.part});
    if (!filter.verdict.empty()) where.add("verdict = ", filter.verdict);
    if (!filter.reason.empty()) {
        std::string present = "CASE reason";
        for (const auto& [name, reason] : algo::kFormerReasonNames)
            present += fmt::format(" WHEN '{}' THEN '{}'", name, algo::name_of(reason));
        where.add(present + " ELSE reason END = ", std::string(algo::present_reason_name(filter.reason)));
    }
    if (!filter.recipe.empty())
        where.add("recipe IN (SELECT number FROM changes WHERE what = 'recipe' AND name = ", filter.recipe);
    if (!filter.kind.empty())
        where.add(
            "EXISTS (SELECT 1 FROM json_each(iif(json_valid(defects), defects, '[]')) WHERE type = 'object' AND "
            "json_extract(value, '$.kind') = ",
            filter.kind);
    if (filter.after) where.add("number > ", *filter.after);
    const std::string chosen = "SELECT * FROM results " + where.sql();
    const std::string inner = filter.oldest ? chosen + " ORDER BY number LIMIT " + std::to_string(*filter.oldest)
                                            : newest_of(chosen, filter.newest);
    const std::string sql =
        "SELECT r.number, r.run, r.time_us, s.after, r.sequence, r.part, r.verdict, r.reason, r.reject, r.score, "
        "r.defect_count, r.defects, r.latency_us, r.reject_latency_us, r.recipe, p.name, c.name, r.bounded FROM (" +
        inner +
        ") r LEFT JOIN changes s ON s.number = r.run LEFT JOIN changes p ON p.number = r.recipe "
        "LEFT JOIN changes c ON c.number = r.calibration ORDER BY r.number";
    std::optional<std::int64_t> known_run;
    StoredResult result;
    const auto read_row = [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        result.number = read.integer(0);
        result.run = read.integer(1);
        result.time_us = read.integer(2);
        if (result.run != known_run) {
            known_run = result.run;
            const Json start = parse_stored(read.text_or_empty(3));
            const std::int64_t boot = integer_in(start, "boot").value_or(0);
            result.boot =
                boot >= 0 && boot <= std::numeric_limits<std::uint32_t>::max() ? static_cast<std::uint32_t>(boot) : 0;
            result.software = text_in(start, "software").value_or("");
        }
        result.sequence = read.natural(4);
        result.part = read.natural(5);
        result.verdict = read.text(6);
        result.reason = algo::present_reason_name(read.text(7));
        result.reject = read.text(8);
        result.score = read.real_or_null(9);
        result.defect_count = read.integer(10);
        result.defects = read.text(11);
        result.latency_us = read.integer(12);
        result.reject_latency_us = read.integer(13);
        result.recipe_change = read.integer_or_null(14).value_or(0);
        // Of other rows: their damage is not this row's.
        result.recipe = read.text_or_empty(15);
        result.calibration = read.text_or_empty(16);
        const auto bounded = read.integer_or_null(17);
        result.bounded = bounded ? std::optional(*bounded != 0) : std::nullopt;
        result.damage = read.error() ? read.error()->what : "";
        take(result);
        return {};
    };
    return database_->run(sql, where.values(), read_row);
}

Result<void> StoreReader::each_count(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                                     const std::function<void(const ResultCount&)>& take) {
    const std::int64_t step_us = std::chrono::microseconds(period).count();
    const char* sql =
        "SELECT b * ?3, p.name, c.verdict, c.reason, c.parts FROM (SELECT time_us / ?3 b, recipe, verdict, reason, "
        "count(*) parts FROM results WHERE time_us >= ?1 AND time_us < ?2 GROUP BY 1, 2, 3, 4) c LEFT JOIN changes p "
        "ON p.number = c.recipe ORDER BY 1";
    return database_->run(sql, std::array<Value, 3>{since, until, step_us}, [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        take({read.integer(0),
              read.text_or_empty(1),
              read.text_or_empty(2),
              std::string(algo::present_reason_name(read.text_or_empty(3))),
              {},
              read.integer(4)});
        return {};
    });
}

Result<void> StoreReader::each_kind_count(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                                          const std::function<void(const ResultCount&)>& take) {
    const std::int64_t step_us = std::chrono::microseconds(period).count();
    const char* sql =
        "SELECT b * ?3, p.name, c.kind, c.parts FROM (SELECT time_us / ?3 b, recipe, json_extract(d.value, '$.kind') "
        "kind, count(DISTINCT results.number) parts FROM results, json_each(iif(json_valid(defects), defects, '[]')) d "
        "WHERE time_us >= ?1 AND time_us < ?2 AND verdict <> 'pass' AND d.type = 'object' GROUP BY 1, 2, 3) c LEFT "
        "JOIN changes p ON p.number = c.recipe ORDER BY 1";
    return database_->run(sql, std::array<Value, 3>{since, until, step_us}, [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        take({read.integer(0), read.text_or_empty(1), {}, {}, read.text_or_empty(2), read.integer(3)});
        return {};
    });
}

Result<void> StoreReader::each_score(UtcMicros since, UtcMicros until, std::chrono::seconds period,
                                     const std::function<void(const ScoreCount&)>& take) {
    const std::int64_t step_us = std::chrono::microseconds(period).count();
    const char* sql =
        "SELECT time_us / ?3 * ?3, avg(iif(verdict = 'pass', score, NULL)), max(iif(verdict = 'pass', score, NULL)), "
        "max(iif(verdict <> 'pass', score, NULL)) FROM results WHERE time_us >= ?1 AND time_us < ?2 AND typeof(score) "
        "= 'real' GROUP BY 1 ORDER BY 1";
    return database_->run(sql, std::array<Value, 3>{since, until, step_us}, [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        take({read.integer(0), read.real_or_null(1), read.real_or_null(2), read.real_or_null(3)});
        return {};
    });
}

Result<void> StoreReader::each_change(const ResultFilter& filter,
                                      const std::function<void(const StoredChange&)>& take) {
    Conditions where;
    add_times(where, filter);
    if (!filter.what.empty()) where.add("what = ", filter.what);
    // Changes and commands have numbers of their own; together they are in the order of their times.
    const std::string both =
        "SELECT * FROM (SELECT number, run, time_us, what, peer, token, name, before, after, entry FROM changes UNION "
        "ALL "
        "SELECT number, run, time_us, 'command', peer, token, name, before, after, entry FROM commands) " +
        where.sql();
    const std::string order = " ORDER BY time_us, run, entry";
    const std::string newest_first = " ORDER BY time_us DESC, run DESC, entry DESC";
    const std::string sql = filter.newest
        ? "SELECT * FROM (" + both + newest_first + " LIMIT " + std::to_string(*filter.newest) + ")" + order
        : both + order;
    return database_->run(sql, where.values(), [&](const Statement& row) -> Result<void> {
        RowReader read(row);
        StoredChange change;
        change.number = read.integer(0);
        change.run = read.integer(1);
        change.time_us = read.integer(2);
        change.what = read.text(3);
        change.peer = read.text(4);
        change.token = read.natural(5);
        change.name = read.text(6);
        change.before = read.text(7);
        change.after = read.text(8);
        if (read.error()) change.damage = read.error()->what;
        take(change);
        return {};
    });
}

}  // namespace hord::firmware::store
