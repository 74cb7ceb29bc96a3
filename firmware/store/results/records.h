// Records as rows of the database, and the texts in them: shared by writer and reader.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/store/results/database.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

// A row keeps at most so many defects, those with the largest peaks; defect_count counts all.
constexpr std::size_t kDefectsKept = 64;

// [{"m":12.5,"n":3,"area":4,"peak":1.25,"kind":"scratch"}], each number read back to the bit.
Json to_json(std::span<const algo::Defect> defects);

// The text in column `after` of a start row: {"boot":1234,"software":"0.1.0"}
std::string to_json_line(const StartRecord& start);

// The values of a row after the shared columns (schema.h), in the order of the table.
std::vector<Value> values_of(const ResultRecord& record, const Value& recipe, const Value& calibration);
std::vector<Value> values_of(const ChangeRecord& record);
std::vector<Value> values_of(const StartRecord& record, const std::string& before);

}  // namespace hord::firmware::store
