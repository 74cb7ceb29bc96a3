#include "firmware/page/results.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstring>
#include <mutex>
#include <ranges>
#include <set>

#include <fmt/format.h>

#include "firmware/core/enum_values.h"
#include "firmware/core/station_types.h"
#include "firmware/store/results/export.h"
#include "firmware/store/results/records.h"

namespace hord::firmware::page {
namespace {

using store::Json;
using store::StoredChange;
using store::StoredResult;

constexpr auto kTimeout = std::chrono::milliseconds(3000);  // of one query
constexpr std::size_t kLongestValue = 100;

template <class Int>
std::optional<Int> whole(std::string_view text, int base = 10) {
    Int value = 0;
    const auto read = std::from_chars(text.data(), text.data() + text.size(), value, base);
    if (text.empty() || read.ec != std::errc() || read.ptr != text.data() + text.size()) return std::nullopt;
    return value;
}

bool is_word(std::string_view text) {
    return std::all_of(text.begin(), text.end(), [](unsigned char c) { return c >= 0x20 && c != 0x7F; });
}

// One of the names that `values` have: else the error lists them.
template <class Values>
Result<void> one_of(const std::string& name, const std::string& value, const Values& values) {
    std::vector<std::string_view> names;
    for (const auto& one : values) names.push_back(name_of(one));
    if (std::ranges::find(names, value) != names.end()) return {};
    return fail(ErrorCode::invalid_argument, fmt::format("{} cannot be \"{}\"", name, value.substr(0, 40)),
                fmt::format("use one of {}", fmt::join(names, ", ")));
}

// Refuses unknown, repeated and malformed filters: ignoring one would show wrong rows.
Result<store::ResultFilter> filter_of(const Fields& fields, std::int64_t usual, std::int64_t most) {
    store::ResultFilter filter;
    filter.newest = usual;
    for (const auto& [name, value] : fields) {
        if (std::ranges::find(kFilters, name) == std::end(kFilters))
            return fail(ErrorCode::invalid_argument, "there is no filter \"" + name.substr(0, 40) + "\"",
                        fmt::format("use {}", fmt::join(kFilters, ", ")));
        if (fields.count(name) > 1)
            return fail(ErrorCode::invalid_argument, name + " is given more than once", "give it once");
        if (value.empty()) continue;
        const auto wrong = [&name = name, &value = value](const char* cure) {
            return fail(ErrorCode::invalid_argument, fmt::format("{} cannot be \"{}\"", name, value.substr(0, 40)),
                        cure);
        };
        if (value.size() > kLongestValue || !is_word(value))
            return fail(ErrorCode::invalid_argument, name.substr(0, 20) + " is too long, or holds what is no text",
                        "write at most 100 characters");
        if (name == "verdict") {
            if (auto known = one_of(name, value, kValuesOf<PartVerdict>); !known) return tl::unexpected(known.error());
            filter.verdict = value;
        } else if (name == "reason") {
            if (auto known = one_of(name, value, kValuesOf<PartReason>); !known) return tl::unexpected(known.error());
            filter.reason = value;
        } else if (name == "kind") {
            if (auto known = one_of(name, value, kDefectKinds); !known) return tl::unexpected(known.error());
            filter.kind = value;
        } else if (name == "recipe") {
            filter.recipe = value;
        } else if (name == "part") {
            filter.part = whole<std::uint32_t>(value);
            if (!filter.part || *filter.part == 0) return wrong("write a part's number");
        } else if (name == "before") {
            filter.before = whole<std::int64_t>(value);
            if (!filter.before || *filter.before < 1) return wrong("write a result's number");
        } else if (name == "limit") {
            const auto limit = whole<std::int64_t>(value);
            if (!limit || *limit < 1 || *limit > most) {
                return fail(ErrorCode::invalid_argument, fmt::format("limit cannot be \"{}\"", value.substr(0, 40)),
                            fmt::format("write 1 to {}", most));
            }
            filter.newest = *limit;
        } else {
            const auto time = store::parse_utc(value, store::utc_now());
            if (!time) return tl::unexpected(time.error());
            (name == "since" ? filter.since : filter.until) = *time;
        }
    }
    if (auto fine = store::check_period(filter.since, filter.until); !fine) return tl::unexpected(fine.error());
    return filter;
}

tl::unexpected<Error> others_search() {
    return fail(ErrorCode::busy, "others are searching the store", "try again in a moment");
}

}  // namespace

std::optional<PartKey> parse_part_key(std::string_view text) {
    if (const auto number = whole<std::int64_t>(text))
        return *number > 0 ? std::optional(PartKey{*number, 0, 0}) : std::nullopt;
    const auto dash = text.find('-');
    if (dash != 8) return std::nullopt;
    const auto boot = whole<std::uint32_t>(text.substr(0, 8), 16), part = whole<std::uint32_t>(text.substr(9));
    if (!boot || !part) return std::nullopt;
    return PartKey{std::nullopt, *boot, *part};
}

Result<std::unique_ptr<store::StoreReader>> Results::open() {
    if (folder_.empty())
        return fail(ErrorCode::not_found, "this page knows no store", "name it in page.toml: [station] store");
    auto reader = store::StoreReader::open(folder_);
    if (reader) (*reader)->limit_time(kTimeout);
    return reader;
}

template <class Row>
Result<std::vector<Row>> Results::read(const store::ResultFilter& filter, Each<Row> each) {
    const std::unique_lock lock(mutex_, kTimeout);
    if (!lock) return others_search();
    auto reader = open();
    if (!reader) return tl::unexpected(reader.error());
    std::vector<Row> rows;
    return ((**reader).*each)(filter, [&](const Row& row) { rows.push_back(row); }).map([&] {
        return std::move(rows);
    });
}

Result<Json> Results::search(const Fields& fields) {
    auto filter = filter_of(fields, 50, kMaxRows);
    if (!filter) return tl::unexpected(filter.error());
    const auto limit = static_cast<std::size_t>(*filter->newest);
    filter->newest = *filter->newest + 1;  // one more, to know whether there are more
    const auto found = read(*filter, &store::StoreReader::each_result);
    if (!found) return tl::unexpected(found.error());
    if (found->empty() && !filter->recipe.empty()) {
        if (auto known = refuse_unknown_recipe(filter->recipe); !known) return tl::unexpected(known.error());
    }
    Json rows = Json::array();
    for (auto row = found->rbegin(); row != found->rend() && rows.size() < limit; ++row)
        rows.push_back(store::to_json(*row));
    return Json{{"rows", std::move(rows)}, {"more", found->size() > limit}};
}

Result<void> Results::refuse_unknown_recipe(const std::string& name) {
    store::ResultFilter filter;
    filter.what = "recipe";
    const auto changes = read(filter, &store::StoreReader::each_change);
    if (!changes) return tl::unexpected(changes.error());
    std::set<std::string> names;
    for (const StoredChange& change : *changes) names.insert(change.name);
    if (names.contains(name)) return {};
    return fail(ErrorCode::invalid_argument, fmt::format("recipe cannot be \"{}\"", name.substr(0, 40)),
                names.empty() ? std::string("no recipe is stored yet: leave it out")
                              : fmt::format("use one of {}", fmt::join(names, ", ")));
}

Result<std::string> Results::csv(const Fields& fields) {
    const auto filter = filter_of(fields, kMaxCsvRows, kMaxCsvRows);
    if (!filter) return tl::unexpected(filter.error());
    const auto found = read(*filter, &store::StoreReader::each_result);
    if (!found) return tl::unexpected(found.error());
    if (found->empty() && !filter->recipe.empty()) {
        if (auto known = refuse_unknown_recipe(filter->recipe); !known) return tl::unexpected(known.error());
    }
    std::string text = store::csv_head_of_results() + "\r\n";
    for (const StoredResult& row : *found) text += store::to_csv(row) + "\r\n";
    return text;
}

Result<Json> Results::by_period(std::chrono::seconds span, std::chrono::seconds step, const Fill& fill) {
    const std::unique_lock lock(mutex_, kTimeout);
    if (!lock) return others_search();
    auto reader = open();
    if (!reader) return tl::unexpected(reader.error());
    const std::int64_t step_us = std::chrono::microseconds(step).count();
    const store::UtcMicros now = store::utc_now();
    const store::UtcMicros since = (now - std::chrono::microseconds(span).count()) / step_us * step_us;
    Json found{{"step_s", step.count()}};
    return fill(**reader, since, now + step_us, found).map([&] { return std::move(found); });
}

Result<Json> Results::counts(bool week) {
    using namespace std::chrono;
    const seconds step = week ? hours(1) : minutes(15), span = week ? days(7) : days(1);
    return by_period(span, step, [&](auto& reader, store::UtcMicros since, store::UtcMicros until, Json& found) {
        Json rows = Json::array(), kinds = Json::array();
        auto done = reader.each_count(since, until, step, [&](const store::ResultCount& c) {
            rows.push_back({c.since_us / 1'000'000, c.recipe, c.verdict, c.reason, c.parts});
        });
        if (done)
            done = reader.each_kind_count(since, until, step, [&](const store::ResultCount& c) {
                kinds.push_back({c.since_us / 1'000'000, c.recipe, c.kind, c.parts});
            });
        found["rows"] = std::move(rows);
        found["kinds"] = std::move(kinds);
        return done;
    });
}

Result<Json> Results::scores(bool day) {
    using namespace std::chrono;
    const seconds step = day ? seconds(minutes(5)) : seconds(5), span = day ? seconds(days(1)) : minutes(15);
    return by_period(span, step, [&](auto& reader, store::UtcMicros since, store::UtcMicros until, Json& found) {
        const auto value = [](std::optional<double> of) { return of ? Json(*of) : Json(); };
        Json rows = Json::array();
        auto done = reader.each_score(since, until, step, [&](const store::ScoreCount& c) {
            rows.push_back(
                {c.since_us / 1'000'000, value(c.passed_mean), value(c.passed_highest), value(c.other_highest)});
        });
        found["fields"] = {"passed_mean", "passed_highest", "other_highest"};
        found["rows"] = std::move(rows);
        return done;
    });
}

Result<StoredResult> Results::one(const PartKey& key) {
    store::ResultFilter filter;
    filter.newest = 1;
    if (key.number) filter.number = key.number;
    else {
        filter.boot = key.boot;
        filter.part = key.part;
    }
    auto found = read(filter, &store::StoreReader::each_result);
    if (!found) return tl::unexpected(found.error());
    if (found->empty())
        return fail(ErrorCode::not_found, "the store holds no such part",
                    "it was never stored, is not stored yet, or was removed because of its age");
    return std::move(found->front());
}

Result<Json> Results::changes(std::int64_t most) {
    store::ResultFilter filter;
    filter.newest = most;
    auto found = read(filter, &store::StoreReader::each_change);
    if (!found) return tl::unexpected(found.error());
    std::ranges::reverse(*found);
    Json rows = Json::array();
    for (const StoredChange& c : *found) {
        Json row{{"time", store::format_utc(c.time_us)},
                 {"what", c.what},
                 {"name", c.name},
                 {"peer", c.peer},
                 {"token", c.token}};
        if (c.what == "command") {
            row["before"] = c.before;
            row["after"] = c.after;
        }
        if (!c.damage.empty()) row["damage"] = c.damage;
        rows.push_back(std::move(row));
    }
    return Json{{"rows", std::move(rows)}};
}

Result<Json> Results::recipe_in_use() {
    store::ResultFilter filter;
    filter.what = "recipe";
    filter.newest = 1;
    const auto found = read(filter, &store::StoreReader::each_change);
    if (!found) return tl::unexpected(found.error());
    if (found->empty())
        return fail(ErrorCode::not_found, "the store knows no recipe", "start the station once with its store");
    const StoredChange& newest = found->front();
    return Json{{"name", newest.name},
                {"time", store::format_utc(newest.time_us)},
                {"peer", newest.peer},
                {"text", newest.after}};
}

std::string tar_header(const std::string& name, std::size_t size, std::int64_t time_s) {
    std::string header(kTarBlock, '\0');
    const auto put = [&](std::size_t at, const std::string& text) {
        std::memcpy(header.data() + at, text.data(), text.size());
    };
    put(0, name.substr(0, 99));
    put(100, "0000644");
    put(108, "0000000");
    put(116, "0000000");
    put(124, fmt::format("{:011o}", size));
    put(136, fmt::format("{:011o}", std::max<std::int64_t>(time_s, 0)));
    put(148, "        ");  // the checksum field counts as blanks
    put(156, "0");
    put(257,
        std::string("ustar\0"
                    "00",
                    8));
    unsigned sum = 0;
    for (const char c : header) sum += static_cast<unsigned char>(c);
    put(148, fmt::format("{:06o}", sum) + std::string("\0 ", 2));
    return header;
}

std::string tar_padding(std::size_t size) { return std::string((kTarBlock - size % kTarBlock) % kTarBlock, '\0'); }

}  // namespace hord::firmware::page
