// Verifies the hash chains of a store: finds rows that were edited, removed, inserted or moved.
#include <algorithm>
#include <array>
#include <limits>

#include <fmt/format.h>

#include "firmware/store/results/export.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/schema.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::store {
namespace {

constexpr std::size_t kProblemsTold = 100;

std::string rows(std::int64_t from, std::int64_t to, std::string_view one, std::string_view several) {
    return from == to ? fmt::format("row {} {}", from, one) : fmt::format("rows {} to {} {}", from, to, several);
}

// The number after `number`, also where an edited one is the largest integer.
std::int64_t next(std::int64_t number) {
    return number == std::numeric_limits<std::int64_t>::max() ? number : number + 1;
}

// One chain, checked row by row.
class ChainCheck {
  public:
    ChainCheck(Database& database, const std::string& store_id, const ChainTable& table,
               const std::vector<ChainHead>& noted)
        : database_(database), store_id_(store_id), table_(table), name_(table.name) {
        for (const ChainHead& head : noted) {
            if (head.chain == name_) noted_.push_back(head);
        }
    }

    // `known_changes`: the numbers that rows may refer to.
    Result<void> run(std::int64_t known_changes) {
        if (auto done = find_begin(); !done) return done;
        const std::string all =
            fmt::format("SELECT {}, hash FROM {} ORDER BY number", fmt::join(table_.columns, ", "), name_);
        const auto check = [&](const Statement& row) -> Result<void> {
            check_row(row, known_changes);
            return {};
        };
        if (auto done = database_.run(all, {}, check); !done) return done;
        if (auto done = check_head(); !done) return done;
        for (const ChainHead& head : noted_) {
            if (head.number > head_.number)
                problem(fmt::format("row {}, noted before, is missing at the end", head.number));
        }
        if (problems_ > kProblemsTold)
            told_.push_back(fmt::format("{}: {} further problems", name_, problems_ - kProblemsTold));
        return {};
    }

    [[nodiscard]] const ChainHead& head() const { return head_; }
    [[nodiscard]] const std::vector<std::string>& told() const { return told_; }
    [[nodiscard]] const std::string& removed() const { return removed_; }  // by retention; empty: nothing

  private:
    void problem(const std::string& what) {
        if (++problems_ <= kProblemsTold) told_.push_back(name_ + ": " + what);
    }

    // Row 1 follows genesis; a later first row follows the last row that retention removed, whose hash it recorded.
    Result<void> find_begin() {
        before_ = genesis(store_id_, table_.name);
        head_.chain = name_;
        const std::array<Value, 1> name{name_};
        auto last = database_.get(
            "SELECT after FROM changes WHERE what = 'retention' AND name = ?1 ORDER BY number DESC LIMIT 1", name);
        if (!last) return tl::unexpected(last.error());
        if (std::holds_alternative<std::monostate>(*last)) return {};
        const auto* text = std::get_if<std::string>(&*last);
        const Json json = parse_stored(text == nullptr ? "" : *text);
        const auto to = integer_in(json, "to");
        const auto hash = to ? hash_from_hex(text_in(json, "hash").value_or("")) : std::nullopt;
        if (!hash) {
            problem("what retention removed cannot be read");
            return {};
        }
        begin_ = *to;
        before_ = *hash;
        if (auto done = describe_removals(*text); !done) return done;
        for (const ChainHead& head : noted_) {
            if (head.number == begin_ && head.hash != to_hex(before_))
                problem(fmt::format("row {}, removed by retention, had another hash than was noted", begin_));
        }
        return {};
    }

    Result<void> describe_removals(const std::string& newest) {
        const std::array<Value, 1> name{name_};
        const auto steps =
            database_.get_integer("SELECT count(*) FROM changes WHERE what = 'retention' AND name = ?1", name);
        if (!steps) return tl::unexpected(steps.error());
        const auto when = database_.get_integer(
            "SELECT time_us FROM changes WHERE what = 'retention' AND name = ?1 ORDER BY number DESC LIMIT 1", name);
        removed_ = fmt::format(
            "{}: retention has removed rows up to {} ({} entries in `hordctl results changes`; the "
            "newest of {}: {})",
            name_, begin_, *steps, when ? format_utc(*when) : "?", describe_removal(newest));
        return {};
    }

    void check_row(const Statement& row, std::int64_t known_changes) {
        const int hash_column = row.columns() - 1;
        // Values of another type count as 0: their row's hash does not fit either.
        const auto integer = [&](int column) { return row.integer(column).value_or(0); };
        const std::int64_t number = integer(kNumberColumn), version = integer(kVersionColumn);
        const std::int64_t expected = next(head_.rows == 0 ? begin_ : head_.number);
        if (head_.rows == 0) head_.first = number;
        if (number > expected) {
            problem(rows(expected, number - 1, "is missing", "are missing"));
        } else if (number < expected) {
            problem(fmt::format("row {} was inserted before the first", number));
        }
        ++head_.rows;
        head_.number = number;

        std::vector<Value> values;
        for (int column = 0; column < hash_column; ++column) values.push_back(row.value(column));
        bool good = version >= 1 && version <= kSchemaVersion;
        for (; version < 3 && values.size() > table_.columns_before_3; values.pop_back())
            good = good && std::holds_alternative<std::monostate>(values.back());
        const Hash hash = follow(before_, values);
        const Value stored = row.value(hash_column);
        if (!good || !equals(stored, hash)) {
            problem(number == expected ? fmt::format("row {} is not as it was written", number)
                                       : fmt::format("row {} does not follow from the row before it", number));
        }
        // Continue from the stored hash, so that one edited row is one problem.
        before_ = hash;
        if (const auto* blob = std::get_if<Blob>(&stored); blob != nullptr && blob->size() == before_.size()) {
            std::copy(blob->begin(), blob->end(), before_.begin());
        }
        if (integer(kRunColumn) > known_changes)
            problem(fmt::format("row {} belongs to a run that the changes do not know", number));
        for (const ChainHead& head : noted_) {
            if (head.number == number && head.hash != to_hex(before_))
                problem(fmt::format("row {} has another hash than was noted", number));
        }
    }

    Result<void> check_head() {
        const std::array<Value, 1> name{name_};
        auto number = database_.get_integer("SELECT number FROM heads WHERE chain = ?1", name);
        auto hash = database_.get("SELECT hash FROM heads WHERE chain = ?1", name);
        if (!hash) return tl::unexpected(hash.error());
        head_.hash = to_hex(before_);
        if (!number && number.error().code == ErrorCode::unreadable) {
            problem("the number of the row that was written last cannot be read");
            return {};
        }
        if (!number) return tl::unexpected(number.error());
        if (*number > head_.number) {
            problem(
                rows(next(std::max(head_.number, begin_)), *number, "is missing at the end", "are missing at the end"));
        } else if (*number < head_.number) {
            problem(rows(next(*number), head_.number, "was inserted at the end", "were inserted at the end"));
        } else if (*number != 0 && !equals(*hash, before_)) {
            problem(fmt::format("row {} is not the one that was written last", *number));
        }
        return {};
    }

    Database& database_;
    const std::string& store_id_;
    const ChainTable& table_;
    const std::string name_;
    std::vector<ChainHead> noted_;
    Hash before_{};
    std::int64_t begin_ = 0;  // the row before the first
    ChainHead head_;
    std::size_t problems_ = 0;
    std::vector<std::string> told_;
    std::string removed_;
};

}  // namespace

Result<Verification> StoreReader::verify(const std::vector<ChainHead>& noted) {
    Verification verification;
    Database& database = *database_;
    // One read transaction: a consistent view while the station writes.
    if (auto done = database.execute("BEGIN"); !done) return tl::unexpected(done.error());
    const auto checked = [&]() -> Result<void> {
        const auto read_page = [&](const Statement& row) -> Result<void> {
            const std::string said = row.text(0).value_or("integrity_check gives no text");
            if (said != "ok") verification.problems.push_back("file: " + said);
            return {};
        };
        if (auto done = database.run("PRAGMA integrity_check", {}, read_page); !done) return done;
        const auto changes = database.get_integer("SELECT max(number) FROM changes");
        if (!changes) return tl::unexpected(changes.error());
        for (const ChainTable* table : {&kChanges, &kCommands, &kResults}) {
            ChainCheck check(database, id_, *table, noted);
            if (auto done = check.run(*changes); !done) return done;
            verification.heads.push_back(check.head());
            if (!check.removed().empty()) verification.removed.push_back(check.removed());
            verification.problems.insert(verification.problems.end(), check.told().begin(), check.told().end());
        }
        return {};
    }();
    (void)database.execute("COMMIT");
    if (!checked) return tl::unexpected(checked.error());
    return verification;
}

}  // namespace hord::firmware::store
