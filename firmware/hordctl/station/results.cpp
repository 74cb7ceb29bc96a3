// hordctl results: lists, filters, exports and verifies the results in a store.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/assign.h"
#include "common/cli/message.h"
#include "firmware/core/enum_values.h"
#include "firmware/core/station_types.h"
#include "firmware/hordctl/commands.h"
#include "firmware/store/results/export.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware {
namespace {

using store::StoreReader;

constexpr std::size_t kDamagedTold = 20;  // damaged rows that are named one by one

struct ResultsOptions {
    std::string folder = kDefaultStore;
    std::string since, until, format = "table";
    store::ResultFilter filter;
    std::vector<std::string> noted;
};

Result<void> complete(ResultsOptions& options) {
    const auto read = [](const std::string& text, std::optional<store::UtcMicros>& into) -> Result<void> {
        if (text.empty()) return {};
        return assign(into, store::parse_utc(text, store::utc_now()));
    };
    if (auto done = read(options.since, options.filter.since); !done) return done;
    if (auto done = read(options.until, options.filter.until); !done) return done;
    if (auto fine = store::check_period(options.filter.since, options.filter.until); !fine) return fine;
    if (options.filter.reason.empty()) return {};
    const auto present = algo::present_reason_name(options.filter.reason);
    if (present != options.filter.reason)
        print_message("hordctl: the reason \"{}\" is called \"{}\" now\n", options.filter.reason, present);
    std::vector<std::string_view> known;
    for (const PartReason reason : kValuesOf<PartReason>) known.push_back(name_of(reason));
    if (std::ranges::find(known, present) == known.end()) {
        return fail(ErrorCode::invalid_argument, "no reason is called \"" + options.filter.reason + "\"",
                    fmt::format("use one of {}", fmt::join(known, ", ")));
    }
    return {};
}

// Fails with invalid_argument if no recipe of this name was ever in use.
Result<void> check_recipe(StoreReader& reader, const std::string& name) {
    std::set<std::string> known;
    store::ResultFilter recipes;
    recipes.what = "recipe";
    if (auto done = reader.each_change(recipes, [&](const store::StoredChange& row) { known.insert(row.name); }); !done)
        return done;
    if (known.empty() || known.contains(name)) return {};
    return fail(ErrorCode::invalid_argument, "no recipe of this store is called \"" + name + "\"",
                fmt::format("use one of {}", fmt::join(known, ", ")));
}

// Says how old the store's newest result is: old results look like those of a station that runs.
void print_age(StoreReader& reader) {
    store::ResultFilter newest;
    newest.newest = 1;
    const auto said = reader.each_result(newest, [](const store::StoredResult& row) {
        constexpr std::int64_t kSecond_us = 1'000'000, kDay_s = 86'400;
        const std::int64_t age_s = (store::utc_now() - row.time_us) / kSecond_us;
        const auto age = age_s < 0 ? std::string("in the future: is this machine's clock wrong?")
            : age_s < 120          ? fmt::format("{} s ago", age_s)
            : age_s < 2 * 3600     ? fmt::format("{} min ago", age_s / 60)
            : age_s < 2 * kDay_s   ? fmt::format("{} h ago", age_s / 3600)
                                   : fmt::format("{} days ago", age_s / kDay_s);
        print_message("hordctl: the newest result of this store is of {}, {}\n", store::format_utc(row.time_us), age);
    });
    (void)said;  // what cannot be read was told before
}

// Prints row by row: a year of results does not fit in memory.
Exit list(ResultsOptions options, bool changes) {
    if (auto done = complete(options); !done) return complain(done.error());
    auto reader = StoreReader::open(options.folder);
    if (!reader) return complain(reader.error());
    const bool csv = options.format == "csv", json = options.format == "json";
    bool headed = false;
    const auto print_head = [&] {
        if (std::exchange(headed, true)) return;
        if (csv) fmt::print("{}\n", changes ? store::csv_head_of_changes() : store::csv_head_of_results());
        else if (!json) fmt::print("{}\n", changes ? store::table_head_of_changes() : store::table_head_of_results());
    };
    std::size_t damaged = 0, rows = 0;
    const auto print = [&](const auto& row) {
        ++rows;
        print_head();
        if (!row.damage.empty() && ++damaged <= kDamagedTold)
            print_message("hordctl: row {}: {}\n", row.number, row.damage);
        fmt::print("{}\n",
                   csv        ? store::to_csv(row)
                       : json ? store::to_line(store::to_json(row))
                              : store::to_table(row));
    };
    const auto done =
        changes ? (*reader)->each_change(options.filter, print) : (*reader)->each_result(options.filter, print);
    if (!done) return complain(done.error());
    if (rows == 0 && !changes && !options.filter.recipe.empty()) {
        if (auto known = check_recipe(**reader, options.filter.recipe); !known) return complain(known.error());
    }
    print_head();
    if (rows == 0) print_message("hordctl: no row of {} is as asked for\n", options.folder);
    if (!changes && !csv && !json) print_age(**reader);
    if (damaged == 0) return Exit::good;
    return complain({ErrorCode::unreadable,
                     fmt::format("{} rows are damaged; what is unreadable is shown as 0 or empty", damaged),
                     "hordctl results verify names every row that is not as it was written"});
}

// "results:4711:9f86d0..."
Result<store::ChainHead> parse_head(const std::string& text) {
    const auto first = text.find(':'), second = text.rfind(':');
    store::ChainHead head;
    if (first != std::string::npos && second != first) {
        head.chain = text.substr(0, first);
        head.number = std::strtoll(text.c_str() + first + 1, nullptr, 10);
        head.hash = text.substr(second + 1);
    }
    const bool known = head.chain == "results" || head.chain == "changes" || head.chain == "commands";
    if (!known || head.number <= 0 || head.hash.size() != 64) {
        return fail(ErrorCode::invalid_argument, "\"" + text + "\" is no head",
                    "give one as `hordctl results verify` printed it: CHAIN:NUMBER:HASH");
    }
    return head;
}

Exit verify(const ResultsOptions& options) {
    std::vector<store::ChainHead> noted;
    for (const std::string& text : options.noted) {
        auto head = parse_head(text);
        if (!head) return complain(head.error());
        noted.push_back(std::move(*head));
    }
    auto reader = StoreReader::open(options.folder);
    if (!reader) return complain(reader.error());
    const auto verification = (*reader)->verify(noted);
    if (!verification) return complain(verification.error());
    for (const std::string& problem : verification->problems) fmt::print("{}\n", problem);
    for (const store::ChainHead& head : verification->heads) {
        if (head.rows == 0) continue;
        fmt::print("{}: {} rows, {} to {}\n", head.chain, head.rows, head.first, head.number);
    }
    for (const std::string& removed : verification->removed) fmt::print("{}\n", removed);
    if (!verification->problems.empty()) {
        fmt::print("NOT as it was written\n");
        return Exit::rejected;
    }
    fmt::print("every row is as it was written; note these heads elsewhere, and compare with --head later:\n");
    for (const store::ChainHead& head : verification->heads) {
        if (head.rows > 0) fmt::print("{}:{}:{}\n", head.chain, head.number, head.hash);
    }
    return Exit::good;
}

void add_folder(CLI::App* command, ResultsOptions& options) {
    command->add_option("--store", options.folder, "Folder of a station's store")->capture_default_str();
}
void add_filters(CLI::App* command, ResultsOptions& options) {
    add_folder(command, options);
    command->add_option("--since", options.since,
                        "From this time on: 2026-11-21, 2026-11-21T07:15:30 (UTC), or how long ago: 30m, 12h, 7d");
    command->add_option("--until", options.until, "Before this time");
    command->add_option("--run", options.filter.run, "Of this run (its number is in `hordctl results changes`)")
        ->check(positive());
    command->add_option("--last", options.filter.newest, "The newest so many")->check(positive());
    command->add_option("--format", options.format, "table, csv, or json (one object a line)")
        ->check(CLI::IsMember({"table", "csv", "json"}))
        ->capture_default_str();
}

}  // namespace

void add_results(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("results", "What a station has kept: list, filter, export, verify");
    auto options = std::make_shared<ResultsOptions>();
    add_filters(command, *options);
    command->add_option("--verdict", options->filter.verdict, "pass, reject or unfit")
        ->check(CLI::IsMember({"pass", "reject", "unfit"}));
    command->add_option("--reason", options->filter.reason, "Such as neighbours-disagree or verdict-late");
    command
        ->add_option("--kind", options->filter.kind,
                     "With such a defect: unknown, scattering, absorbing, surface, scratch")
        ->check(CLI::IsMember({"unknown", "scattering", "absorbing", "surface", "scratch"}));
    command->add_option("--recipe", options->filter.recipe, "Judged with the recipe of this name");
    command->footer(
        "Example: hordctl results --since 12h --verdict reject --format csv > rejects.csv\n"
        "         hordctl results changes --since 7d\n"
        "         hordctl results verify");
    command->require_subcommand(0, 1);

    auto* changes =
        command->add_subcommand("changes", "Starts, recipes, configuration, commands: who changed what from what");
    add_filters(changes, *options);
    changes->footer("Example: hordctl results changes --since 7d --format json");
    auto* verifying = command->add_subcommand("verify", "Whether every row is as it was written");
    add_folder(verifying, *options);
    verifying->add_option("--head", options->noted, "A head that was noted before, CHAIN:NUMBER:HASH; may be repeated");
    verifying->footer(
        "Exit status: 0 every row is as it was written, 1 it is not, 2 the store cannot be read.\n"
        "Example: hordctl results verify --head "
        "results:4711:9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08");
    command->callback([options, changes, verifying, &status] {
        status = verifying->parsed() ? verify(*options) : list(*options, changes->parsed());
    });
}

}  // namespace hord::firmware
