// Verifies the hash chains of a store: finds rows that were edited, removed, inserted or moved.
#include <algorithm>
#include <array>

#include <fmt/format.h>

#include "firmware/store/results/json_text.h"
#include "firmware/store/results/schema.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::store {
namespace {

constexpr std::size_t kProblemsTold = 100;

std::string rows(std::int64_t from, std::int64_t to, std::string_view one, std::string_view several) {
    return from == to ? fmt::format("row {} {}", from, one) : fmt::format("rows {} to {} {}", from, to, several);
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
        const auto check = [&](const Statement& row) { check_row(row, known_changes); };
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

  private:
    void problem(const std::string& what) {
        if (++problems_ <= kProblemsTold) told_.push_back(name_ + ": " + what);
    }

    // Row 1 follows genesis; a later first row follows the last row that retention removed, whose hash it recorded.
    Result<void> find_begin() {
        before_ = genesis(store_id_, table_.name);
        head_.chain = name_;
        auto last = database_.get(
            "SELECT after FROM changes WHERE what = 'retention' AND name = ?1 ORDER BY number DESC LIMIT 1",
            std::array<Value, 1>{name_});
        if (!last) return tl::unexpected(last.error());
        const auto* text = std::get_if<std::string>(&*last);
        if (text == nullptr) return {};
        const Json json = Json::parse(*text, nullptr, false);
        const bool whole = json.is_object() && json.contains("to") && json["to"].is_number_integer() &&
            json.contains("hash") && json["hash"].is_string();
        const auto hash = whole ? hash_from_hex(json["hash"].get<std::string>()) : std::nullopt;
        if (!hash) {
            problem("what retention removed cannot be read");
            return {};
        }
        begin_ = json["to"].get<std::int64_t>();
        before_ = *hash;
        for (const ChainHead& head : noted_) {
            if (head.number == begin_ && head.hash != to_hex(before_))
                problem(fmt::format("row {}, removed by retention, had another hash than was noted", begin_));
        }
        return {};
    }

    void check_row(const Statement& row, std::int64_t known_changes) {
        const int hash_column = row.columns() - 1;
        const std::int64_t number = row.integer(kNumberColumn), version = row.integer(kVersionColumn);
        const std::int64_t expected = head_.rows == 0 ? begin_ + 1 : head_.number + 1;
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
        const bool good = version >= 1 && version <= kSchemaVersion;
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
        if (row.integer(kRunColumn) > known_changes)
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
        if (!number) return tl::unexpected(number.error());
        if (!hash) return tl::unexpected(hash.error());
        if (*number > head_.number) {
            problem(
                rows(std::max(head_.number, begin_) + 1, *number, "is missing at the end", "are missing at the end"));
        } else if (*number < head_.number) {
            problem(rows(*number + 1, head_.number, "was inserted at the end", "were inserted at the end"));
        } else if (*number != 0 && !equals(*hash, before_)) {
            problem(fmt::format("row {} is not the one that was written last", *number));
        }
        head_.hash = to_hex(before_);
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
};

}  // namespace

Result<Verification> StoreReader::verify(const std::vector<ChainHead>& noted) {
    Verification verification;
    Database& database = *database_;
    // One read transaction: a consistent view while the station writes.
    if (auto done = database.execute("BEGIN"); !done) return tl::unexpected(done.error());
    const auto checked = [&]() -> Result<void> {
        const auto read_page = [&](const Statement& row) {
            if (row.text(0) != "ok") verification.problems.push_back("file: " + row.text(0));
        };
        if (auto done = database.run("PRAGMA integrity_check", {}, read_page); !done) return done;
        const auto changes = database.get_integer("SELECT max(number) FROM changes");
        if (!changes) return tl::unexpected(changes.error());
        for (const ChainTable* table : {&kChanges, &kCommands, &kResults}) {
            ChainCheck check(database, id_, *table, noted);
            if (auto done = check.run(*changes); !done) return done;
            verification.heads.push_back(check.head());
            verification.problems.insert(verification.problems.end(), check.told().begin(), check.told().end());
        }
        return {};
    }();
    (void)database.execute("COMMIT");
    if (!checked) return tl::unexpected(checked.error());
    return verification;
}

}  // namespace hord::firmware::store
