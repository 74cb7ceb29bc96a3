// Appends rows to one hash chain of a store.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "firmware/store/results/database.h"
#include "firmware/store/results/hash_chain.h"
#include "firmware/store/results/result_store.h"
#include "firmware/store/results/schema.h"

namespace hord::firmware::store {

class ChainWriter {
  public:
    // Continues the chain of `table`. Fails with unreadable if its head or its numbers are damaged: rows that follow
    // from nothing would never verify.
    static Result<ChainWriter> open(Database& database, const ChainTable& table, const std::string& store_id);

    [[nodiscard]] std::int64_t number() const { return number_; }  // of the newest row; 0: none
    [[nodiscard]] std::int64_t next_number() const { return number_ + 1; }

    // `rest`: the values after the shared columns and the time.
    Result<void> append(std::int64_t run, std::uint64_t entry, UtcMicros time_us, std::vector<Value> rest);

    Result<void> write_head();  // before every commit

  private:
    ChainWriter(const ChainTable& table, Statement insert, Statement set_head)
        : table_(&table), insert_(std::move(insert)), set_head_(std::move(set_head)) {}
    const ChainTable* table_;
    Statement insert_, set_head_;
    std::int64_t number_ = 0;
    Hash hash_{};
    bool touched_ = false;
};

}  // namespace hord::firmware::store
