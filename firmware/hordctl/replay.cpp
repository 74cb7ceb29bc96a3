// hordctl replay: judges the frames that a station has kept once more, and shows what changes; hordctl merge joins its shards.
#include <algorithm>
#include <fstream>
#include <iostream>
#include <memory>
#include <optional>

#include <fmt/format.h>

#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/progress.h"
#include "firmware/recipe_file.h"
#include "firmware/store/frame_archive.h"
#include "firmware/store/replay.h"
#include "firmware/store/store_reader.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

struct ReplayOptions {
    std::string folder = kDefaultStore;
    std::vector<std::string> frames;
    std::string recipe, shard;
    bool today = false, json = false;
};

struct Shard {
    std::uint64_t index = 1, count = 1;  // index from 1
};
Result<Shard> parse_shard(const std::string& text) {
    Shard shard;
    unsigned long long index = 0, count = 0;
    char rest = 0;
    if (text.empty()) return shard;
    if (std::sscanf(text.c_str(), "%llu/%llu%c", &index, &count, &rest) != 2 || index < 1 || index > count) {
        return fail(ErrorCode::invalid_argument, "\"" + text + "\" is no shard", "write 1/4, 2/4, 3/4, 4/4");
    }
    return Shard{index, count};
}

// The recipe that came into use last, as the store has it.
Result<algo::Recipe> recipe_of_today(const std::string& folder) {
    auto reader = store::StoreReader::open(folder);
    if (!reader) return tl::unexpected(reader.error());
    std::string text;
    const auto done = (*reader)->each_change({}, [&](const store::StoredChange& change) {
        if (change.what == "recipe") text = change.after;
    });
    if (!done) return tl::unexpected(done.error());
    if (text.empty()) return fail(ErrorCode::not_found, folder + " knows no recipe", "name one: --recipe FILE");
    return parse_recipe(text, "the recipe in use");
}

Result<std::vector<fs::path>> frames_of(const ReplayOptions& options, const Shard& shard) {
    std::vector<store::ArchivedFile> files;
    if (options.frames.empty()) {
        auto listed = store::list_frames(fs::path(options.folder) / store::kFramesFolder);
        if (!listed) return tl::unexpected(listed.error());
        files = std::move(*listed);
    } else {
        std::uint64_t number = 0;
        for (const std::string& file : options.frames) files.push_back({++number, file, 0});
    }
    std::vector<fs::path> chosen;
    for (const store::ArchivedFile& file : files) {
        if (file.number % shard.count == shard.index - 1) chosen.push_back(file.file);
    }
    return chosen;
}

struct Tally {
    std::size_t frames = 0, same = 0, verdicts = 0, unreadable = 0;
};

Exit run_replay(const ReplayOptions& options) {
    const auto shard = parse_shard(options.shard);
    if (!shard) return complain(shard.error());
    std::optional<algo::Recipe> recipe;
    if (!options.recipe.empty() || options.today) {
        auto loaded = options.today ? recipe_of_today(options.folder) : load_recipe(options.recipe);
        if (!loaded) return complain(loaded.error());
        recipe = std::move(*loaded);
    }
    const auto files = frames_of(options, *shard);
    if (!files) return complain(files.error());
    store::Replay replay(std::move(recipe));
    Tally tally;
    Progress progress("frames", files->size() < 50);
    for (const fs::path& file : *files) {
        const auto replayed = replay.judge(file);
        if (!replayed) {
            if (replayed.error().code == ErrorCode::not_found) continue;  // the ring has made room meanwhile
            ++tally.unreadable;
            complain(replayed.error());
            continue;
        }
        ++tally.frames;
        tally.same += replayed->same() ? 1U : 0U;
        tally.verdicts += replayed->verdict_changes() ? 1U : 0U;
        if (options.json) {
            fmt::print("{}\n", store::to_json_line(*replayed));
        } else if (!replayed->same()) {
            const store::Judgement &then = replayed->then, &now = replayed->now;
            fmt::print("{}: {} {} {:.3f} -> {} {} {:.3f}\n", replayed->frame, then.verdict, then.reason, then.score, now.verdict, now.reason, now.score);
        }
        progress.show(static_cast<double>(tally.frames + tally.unreadable) / static_cast<double>(files->size()));
    }
    fmt::print(options.json ? stderr : stdout, "{} frames: {} bit for bit the same, {} differ, {} of these in the verdict; {} cannot be read\n", tally.frames, tally.same,
               tally.frames - tally.same, tally.verdicts, tally.unreadable);
    if (tally.unreadable > 0) return Exit::bad_input;
    return tally.same == tally.frames ? Exit::good : Exit::rejected;
}

Exit run_merge(const std::vector<std::string>& files) {
    std::vector<std::string> lines;
    for (const std::string& file : files) {
        std::ifstream in(file);
        if (!in) return complain({ErrorCode::not_found, file + " cannot be read", "check the path"});
        for (std::string line; std::getline(in, line);) {
            if (!line.empty()) lines.push_back(line);
        }
    }
    const auto merged = store::merge_lines(std::move(lines));
    if (!merged) return complain(merged.error());
    for (const std::string& line : *merged) fmt::print("{}\n", line);
    return Exit::good;
}

}  // namespace

void add_replay(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("replay", "Judge the frames that a station has kept once more, and show what changes");
    auto options = std::make_shared<ReplayOptions>();
    command->add_option("FRAME", options->frames, "Frames; without any, all of the store");
    command->add_option("--store", options->folder, "Folder of a station's store")->capture_default_str();
    auto* recipe = command->add_option("--recipe", options->recipe, "Judge with this recipe (TOML); without one each frame with its own, the one of then");
    command->add_flag("--today", options->today, "Judge with the recipe that came into use last")->excludes(recipe);
    command->add_option("--shard", options->shard, "Only every N-th frame: 1/4, 2/4, 3/4, 4/4; hordctl merge joins what they print");
    command->add_flag("--json", options->json, "Print one JSON object a frame; the sum goes to stderr");
    command->footer("Exit status: 0 every frame is judged as then, to the bit, 1 something changes, 2 a frame cannot be read.\n"
                    "Example: hordctl replay --recipe stricter.toml");
    command->callback([options, &status] { status = run_replay(*options); });

    auto* merge = program.add_subcommand("merge", "Join what the shards of a replay printed: in the order of the frames, each once");
    auto files = std::make_shared<std::vector<std::string>>();
    merge->add_option("FILE", *files, "Output of hordctl replay --json")->required();
    merge->footer("Example: hordctl merge shard1.jsonl shard2.jsonl > all.jsonl");
    merge->callback([files, &status] { status = run_merge(*files); });
}

}  // namespace hord::firmware
