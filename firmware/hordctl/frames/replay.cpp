// hordctl replay: judges kept frames again, and shows what changes; hordctl merge joins its shards.
#include "firmware/store/frames/replay.h"

#include <iterator>
#include <memory>
#include <optional>
#include <set>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "common/file_writing.h"
#include "firmware/hordctl/commands.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/replay_run.h"
#include "firmware/store/frames/replay_shard.h"
#include "firmware/store/results/sqlite_store.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

struct ReplayOptions {
    std::string folder = kDefaultStore;
    std::vector<std::string> frames;
    std::string recipe, shard = "1/1", out;
    unsigned jobs = 1;
    bool today = false, json = false;
};

// The recipe to judge with, and its text; without one each frame is judged with its own.
struct Chosen {
    std::optional<algo::Recipe> recipe;
    std::string text;
};

Result<std::string> recipe_of_today(const std::string& folder) {
    auto reader = store::StoreReader::open(folder);
    if (!reader) return tl::unexpected(reader.error());
    std::string text;
    const auto done = (*reader)->each_change({}, [&](const store::StoredChange& change) {
        if (change.what == "recipe") text = change.after;
    });
    if (!done) return tl::unexpected(done.error());
    if (text.empty()) return fail(ErrorCode::not_found, folder + " knows no recipe", "name one: --recipe FILE");
    return text;
}

Result<Chosen> choose_recipe(const ReplayOptions& options) {
    Chosen chosen;
    if (options.today) {
        auto text = recipe_of_today(options.folder);
        if (!text) return tl::unexpected(text.error());
        auto recipe = parse_recipe(*text, "the recipe in use");
        if (!recipe) return tl::unexpected(recipe.error());
        chosen = {std::move(*recipe), std::move(*text)};
    } else if (!options.recipe.empty()) {
        auto recipe = load_numbered_recipe(options.recipe);
        if (!recipe) return tl::unexpected(recipe.error());
        chosen = {std::move(recipe->recipe), common::read_file(options.recipe).value_or("")};
    }
    return chosen;
}

// All frames that were named, or all of the store, in order.
Result<std::vector<store::ArchivedFile>> frames_of(const ReplayOptions& options) {
    std::vector<store::ArchivedFile> files;
    if (options.frames.empty()) {
        auto listed = store::list_frames(fs::path(options.folder) / store::kFramesFolder);
        if (!listed) return tl::unexpected(listed.error());
        files = std::move(*listed);
    }
    for (const std::string& file : options.frames) {
        std::error_code error;
        const std::uint64_t bytes = fs::file_size(file, error);
        if (error)
            return fail(ErrorCode::not_found, file + " cannot be read (" + error.message() + ")", "check the path");
        files.push_back({0, file, bytes});
    }
    if (auto ordered = store::put_in_order(files); !ordered) return tl::unexpected(ordered.error());
    return files;
}

std::string summary_of(const store::ReplayTally& tally) {
    const std::uint64_t judged = tally.records - tally.unreadable;
    return fmt::format("{} frames: {} bit for bit the same, {} differ, {} of these in the verdict; {} cannot be read",
                       judged, tally.same, judged - tally.same, tally.verdicts, tally.unreadable);
}

Exit status_of(const store::ReplayTally& tally) {
    if (tally.unreadable > 0) return Exit::bad_input;
    return tally.same == tally.records ? Exit::good : Exit::rejected;
}

// Replays one shard to a file with its identity. Ends with an error when a frame was removed meanwhile: then the
// archive has changed.
Exit write_shard(const ReplayOptions& options, const store::Shard& shard, const Chosen& chosen,
                 const std::vector<store::ArchivedFile>& all, const std::vector<store::ArchivedFile>& mine) {
    auto program = store::program_identity();
    if (!program) return complain(program.error());
    const store::ReplayIdentity identity{store::archive_identity(all), all.size(),
                                         chosen.recipe ? store::text_identity(chosen.text) : "own", HORD_VERSION,
                                         *program};
    auto writer = store::ShardWriter::create(options.out, identity, shard);
    if (!writer) return complain(writer.error());
    std::optional<Error> trouble;
    std::size_t done = 0;
    Progress progress("frames", mine.size() < 50);
    store::replay_all(
        mine, chosen.recipe, options.jobs, [&](const store::ArchivedFile& frame, Result<store::Replayed> replayed) {
            std::string line;
            if (replayed) {
                line = store::to_json_line(*replayed);
            } else {
                const Error& error = replayed.error();
                if (error.code == ErrorCode::not_found) {
                    trouble = Error{error.code, frame.file.string() + " was removed while the archive was replayed",
                                    "copy the archive, and replay the copy"};
                } else if (error.code != ErrorCode::unreadable && error.code != ErrorCode::invalid_argument) {
                    trouble = error;
                }
                if (trouble) return false;
                complain(error);
                line = store::unreadable_line(frame.file.filename().string(), error.code);
            }
            if (auto written = writer->add(line); !written) trouble = written.error();
            progress.show(static_cast<double>(++done) / static_cast<double>(mine.size()));
            return !trouble;
        });
    if (trouble) return complain(*trouble);
    const auto tally = writer->finish();
    if (!tally) return complain(tally.error());
    print_message("{}; shard {} is in {}\n", summary_of(*tally), shard.text(), options.out);
    return status_of(*tally);
}

// Replays to standard output: as text, or as JSON lines.
Exit print_replay(const ReplayOptions& options, const Chosen& chosen, const std::vector<store::ArchivedFile>& mine) {
    store::ReplayTally tally;
    Progress progress("frames", mine.size() < 50);
    store::replay_all(
        mine, chosen.recipe, options.jobs, [&](const store::ArchivedFile&, Result<store::Replayed> replayed) {
            if (!replayed) {
                if (replayed.error().code == ErrorCode::not_found)
                    return true;  // the archive removed the frame meanwhile
                ++tally.records;
                ++tally.unreadable;
                complain(replayed.error());
                return true;
            }
            ++tally.records;
            tally.same += replayed->same() ? 1U : 0U;
            tally.verdicts += replayed->verdict_changes() ? 1U : 0U;
            if (options.json) {
                fmt::print("{}\n", store::to_json_line(*replayed));
            } else if (!replayed->same()) {
                const store::Judgement &then = replayed->then, &now = replayed->now;
                fmt::print("{}: {} {} {:.3f} -> {} {} {:.3f}\n    {}\n", replayed->frame, then.verdict, then.reason,
                           then.score, now.verdict, now.reason, now.score, replayed->sentence);
            }
            progress.show(static_cast<double>(tally.records) / static_cast<double>(mine.size()));
            return true;
        });
    std::fputs((summary_of(tally) + "\n").c_str(), options.json ? stderr : stdout);
    return status_of(tally);
}

// Refuses an output that is the recipe, one of the frames, or the results of a store that frames are kept in.
Result<void> check_out(const ReplayOptions& options, const std::vector<store::ArchivedFile>& all) {
    std::vector<std::string> read{options.recipe};
    std::set<fs::path> stores{options.folder};
    for (const store::ArchivedFile& frame : all) {
        read.push_back(frame.file.string());
        stores.insert(fs::absolute(frame.file).parent_path().parent_path());
    }
    for (const fs::path& folder : stores) {
        for (const char* suffix : {"", "-wal", "-shm"}) read.push_back((folder / store::kStoreFile).string() + suffix);
    }
    return check_outputs({{"--out", options.out}}, read);
}

Exit run_replay(const ReplayOptions& options) {
    const auto shard = store::parse_shard(options.shard);
    if (!shard) return complain(shard.error());
    const auto chosen = choose_recipe(options);
    if (!chosen) return complain(chosen.error());
    const auto all = frames_of(options);
    if (!all) return complain(all.error());
    if (auto fine = check_out(options, *all); !fine) return complain(fine.error());
    std::vector<store::ArchivedFile> mine;
    for (const store::ArchivedFile& file : *all) {
        if (shard->holds(file)) mine.push_back(file);
    }
    return options.out.empty() ? print_replay(options, *chosen, mine)
                               : write_shard(options, *shard, *chosen, *all, mine);
}

Exit run_merge(const std::vector<std::string>& names, const std::string& out) {
    if (auto fine = check_outputs({{"--out", out}}, names); !fine) return complain(fine.error());
    const auto tally = store::merge_shards(std::vector<fs::path>(names.begin(), names.end()), out);
    if (!tally) return complain(tally.error());
    print_message("{}; all of it is in {}\n", summary_of(*tally), out);
    return status_of(*tally);
}

}  // namespace

void add_replay(CLI::App& program, Exit& status) {
    auto* command =
        program.add_subcommand("replay", "Judge the frames that a station has kept again, and show what changes");
    auto options = std::make_shared<ReplayOptions>();
    command->add_option("FRAME", options->frames, "Frames; without any, all of the store");
    command->add_option("--store", options->folder, "Folder of a station's store")->capture_default_str();
    auto* recipe =
        command->add_option("--recipe", options->recipe,
                            "Judge with this recipe (TOML); without one each frame with its own, the one of then");
    command->add_flag("--today", options->today, "Judge with the recipe that came into use last")->excludes(recipe);
    add_number(*command, "--jobs", options->jobs, "Frames judged at the same time; the output does not depend on it", 1,
               256);
    auto* out = command->add_option("--out", options->out,
                                    "Write one JSON object a frame into this file, which appears when it is whole");
    command
        ->add_option("--shard", options->shard,
                     "Only one part of the frames: 1/4, 2/4, 3/4, 4/4; hordctl merge joins their files")
        ->capture_default_str();
    command->add_flag("--json", options->json, "Print one JSON object a frame; the sum goes to stderr")->excludes(out);
    command->footer(
        "Exit status: 0 every frame is judged as then, to the bit, 1 something changes, 2 a frame cannot be read (the "
        "file of --out says which),\n"
        "or nothing was written.\n"
        "Example: hordctl replay --recipe stricter.toml\n"
        "         hordctl replay --shard 1/4 --out 1.jsonl");
    command->callback([options, &status] { status = run_replay(*options); });

    auto* merge =
        program.add_subcommand("merge", "Join the shards of a replay: the same bytes as one replay of everything");
    struct MergeOptions {
        std::vector<std::string> files;
        std::string out;
    };
    auto merging = std::make_shared<MergeOptions>();
    merge
        ->add_option("FILE", merging->files,
                     "Every shard once, in any order: the files of hordctl replay --shard I/N --out FILE")
        ->required();
    merge->add_option("--out", merging->out, "Where to: appears when it is whole")->required();
    merge->footer(
        "Exit status: 0 every frame is judged as then, 1 something changes, 2 a frame could not be read, or the shards "
        "do not belong together:\n"
        "then nothing is written, and the odd one is named.\n"
        "Example: hordctl merge shards/*.jsonl --out all.jsonl");
    merge->callback([merging, &status] { status = run_merge(merging->files, merging->out); });
}

}  // namespace hord::firmware
