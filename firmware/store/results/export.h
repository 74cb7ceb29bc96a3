// Stored rows as text for people and programs: CSV (RFC 4180), JSON (one object a line), a table; and times.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "common/result.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::store {

UtcMicros utc_now();  // by the machine's clock

// "2026-11-21T07:15:00.250Z"
std::string format_utc(UtcMicros time_us);

// "2026-11-21", "2026-11-21T07:15", "2026-11-21T07:15:30", with or without Z, UTC; or a time before `now_us`:
// "90s", "30m", "12h", "7d". Fails with invalid_argument.
Result<UtcMicros> parse_utc(std::string_view text, UtcMicros now_us);

// Fails with invalid_argument for a period that holds no time: it ends before it begins.
Result<void> check_period(std::optional<UtcMicros> since, std::optional<UtcMicros> until);

// New columns are only appended.
std::string csv_head_of_results();
std::string csv_head_of_changes();
std::string to_csv(const StoredResult& result);  // without line end
std::string to_csv(const StoredChange& change);
Json to_json(const StoredResult& result);
Json to_json(const StoredChange& change);

// What retention has entered in the changes, as a sentence: "1 to 998 (2026-01-05T... to 2026-01-06T...) removed: ...".
// The text itself if it cannot be read.
std::string describe_removal(const std::string& after);

std::string table_head_of_results();
std::string table_head_of_changes();
std::string to_table(const StoredResult& result);
std::string to_table(const StoredChange& change);  // for a text of several lines only its size

}  // namespace hord::firmware::store
