#include "firmware/store/results/chain_writer.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace hord::firmware::store {
namespace {

// More rows than a store can have; far from the end of the integers.
constexpr std::int64_t kLastNumber = std::int64_t{1} << 60U;

}  // namespace

Result<ChainWriter> ChainWriter::open(Database& database, const ChainTable& table, const std::string& store_id) {
    const std::vector<std::string_view> places(table.columns.size() + 1, "?");
    auto insert = database.prepare(fmt::format("INSERT INTO {} ({}, hash) VALUES ({})", table.name,
                                               fmt::join(table.columns, ", "), fmt::join(places, ", ")));
    if (!insert) return tl::unexpected(insert.error());
    auto set_head = database.prepare("INSERT OR REPLACE INTO heads VALUES (?1, ?2, ?3)");
    if (!set_head) return tl::unexpected(set_head.error());
    ChainWriter chain(table, std::move(*insert), std::move(*set_head));
    chain.hash_ = genesis(store_id, table.name);
    const std::array<Value, 1> name{std::string(table.name)};
    const auto number = database.get_integer("SELECT number FROM heads WHERE chain = ?1", name);
    const auto hash = database.get("SELECT hash FROM heads WHERE chain = ?1", name);
    const auto newest = database.get_integer(fmt::format("SELECT max(number) FROM {}", table.name));
    if (!number) return tl::unexpected(number.error());
    if (!hash) return tl::unexpected(hash.error());
    if (!newest) return tl::unexpected(newest.error());
    // Rows and head differ only if the file was edited: continue above both; verify reports it.
    chain.number_ = std::max(*number, *newest);
    if (*number < 0 || chain.number_ >= kLastNumber)
        return database.damaged(fmt::format("{} have the impossible number {}", table.name, chain.number_));
    if (std::holds_alternative<std::monostate>(*hash)) return chain;
    const auto* blob = std::get_if<Blob>(&*hash);
    if (blob == nullptr || blob->size() != chain.hash_.size())
        return database.damaged(fmt::format("the head of {} is no hash", table.name));
    std::copy(blob->begin(), blob->end(), chain.hash_.begin());
    return chain;
}

Result<void> ChainWriter::append(std::int64_t run, std::uint64_t entry, UtcMicros time_us, std::vector<Value> rest) {
    ++number_;
    std::vector<Value> row{number_, std::int64_t{kSchemaVersion}, run, static_cast<std::int64_t>(entry), time_us};
    std::move(rest.begin(), rest.end(), std::back_inserter(row));
    hash_ = follow(hash_, row);
    row.push_back(to_value(hash_));
    touched_ = true;
    return insert_.run(row);
}

Result<void> ChainWriter::write_head() {
    if (!std::exchange(touched_, false)) return {};
    return set_head_.run(std::array<Value, 3>{std::string(table_->name), number_, to_value(hash_)});
}

}  // namespace hord::firmware::store
