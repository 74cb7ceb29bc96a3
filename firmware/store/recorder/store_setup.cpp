#include "firmware/store/recorder/store_setup.h"

#include <algorithm>

#include <sys/stat.h>

#include "common/assign.h"
#include "common/file_writing.h"
#include "firmware/station/station.h"
#include "firmware/store/results/export.h"
#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware {
namespace {

constexpr std::uint64_t kMegabyte = 1'000'000;
constexpr std::size_t kFramesInMemory = 256 * kMegabyte;  // bytes; hordd.service has a ceiling

// Collects the fault bits of two threads on the loop's thread.
struct Faults {
    hal::EventLoop& loop;
    RecordingWatchers watchers;
    std::uint32_t active = 0;

    void set(std::uint32_t bit, bool is) {
        active = is ? active | bit : active & ~bit;
        if (watchers.faults) watchers.faults(active);
    }
};

std::function<void(const Error&)> raise(const std::shared_ptr<Faults>& faults, std::uint32_t bit) {
    return [faults, bit](const Error& error) {
        faults->loop.post([faults, bit, error] {
            if (faults->watchers.trouble) faults->watchers.trouble(error);
            faults->set(bit, true);
        });
    };
}
std::function<void()> clear(const std::shared_ptr<Faults>& faults, std::uint32_t bit) {
    return [faults, bit] { faults->loop.post([faults, bit] { faults->set(bit, false); }); };
}

constexpr const char* kStoreFolder = "the store's folder";

// store.folder may name the state folder.
bool is_state_folder(const std::filesystem::path& folder, const Config& config) {
    std::error_code none;
    return !config.state_folder.empty() && std::filesystem::equivalent(folder, config.state_folder, none);
}

// Whether removing frames makes room for results: a plant may mount another disk for them.
bool on_one_disk(const std::filesystem::path& folder) {
    struct stat all {
    }, frames{};
    return ::stat(folder.c_str(), &all) == 0 && ::stat((folder / store::kFramesFolder).c_str(), &frames) == 0 &&
        all.st_dev == frames.st_dev;
}

}  // namespace

Result<StateLock> lock_store(const Config& config) {
    const std::filesystem::path folder = store_folder(config);
    if (folder.empty()) return StateLock();
    (void)common::ensure_folder(folder);  // the store tells what is wrong with it
    StateLock lock;
    if (!is_state_folder(folder, config)) {
        if (auto done = assign(lock, StateLock::take(folder, kStoreFolder)); !done) return tl::unexpected(done.error());
    }
    if (auto free = store::check_not_written(folder); !free) return tl::unexpected(free.error());
    return lock;
}

std::vector<std::string> folders_in_use(const Config& config) {
    std::vector<std::string> all;
    const auto look = [&](std::optional<std::string> use) {
        if (use) all.push_back(std::move(*use));
    };
    if (!config.state_folder.empty()) look(StateLock::in_use(config.state_folder));
    const std::filesystem::path folder = store_folder(config);
    if (!folder.empty() && !is_state_folder(folder, config)) look(StateLock::in_use(folder, kStoreFolder));
    return all;
}

Result<void> check_lock_files(const Config& config) {
    if (!config.state_folder.empty()) {
        if (auto fine = StateLock::check_file(config.state_folder); !fine) return fine;
    }
    const std::filesystem::path folder = store_folder(config);
    return folder.empty() || is_state_folder(folder, config) ? Result<void>() : StateLock::check_file(folder);
}

std::optional<Error> nothing_is_stored(const Config& config) {
    if (!config.store.enabled || !store_folder(config).empty()) return std::nullopt;
    return Error{ErrorCode::not_found,
                 "no result and no frame is stored: store.folder is empty, and there is no state directory",
                 "name store.folder, or a state directory in $STATE_DIRECTORY as systemd does for the service; with "
                 "store.enabled = false this is not told"};
}

std::optional<double> store_disk_free_percent(const Config& config) {
    const std::filesystem::path folder = store_folder(config);
    std::error_code error;
    const auto space = folder.empty() ? std::filesystem::space_info{} : std::filesystem::space(folder, error);
    if (error || space.capacity == 0) return std::nullopt;
    return 100.0 * static_cast<double>(space.available) / static_cast<double>(space.capacity);
}

std::size_t frame_buffers(const StoreConfig& config, const algo::Extents& extents, int bits) {
    const std::size_t bytes = static_cast<std::size_t>(extents.width_px()) *
        static_cast<std::size_t>(extents.height_px()) * (bits > 8 ? 2 : 1);
    const auto least = static_cast<std::size_t>(config.frames_before) + 2,
               most = static_cast<std::size_t>(config.frame_buffers);
    return std::min(most, std::max(least, kFramesInMemory / bytes));
}

std::unique_ptr<store::StationRecorder> make_recorder(hal::EventLoop& loop, const Config& config,
                                                      const Recorded& recorded, const RecordingWatchers& watchers) {
    const std::filesystem::path folder = store_folder(config);
    if (folder.empty()) return nullptr;
    const auto faults = std::make_shared<Faults>(Faults{loop, watchers});
    const StoreConfig& wanted = config.store;

    std::unique_ptr<store::FrameRetention> frames;
    if (wanted.frames_mb > 0) {
        store::FrameRetentionOptions options;
        options.extents = recorded.extents;
        options.station = config.name;
        options.software = recorded.software;
        options.boot = recorded.boot;
        options.before = wanted.frames_before;
        options.after = wanted.frames_after;
        options.sample_every = wanted.sample_every;
        options.buffers = frame_buffers(wanted, recorded.extents, recorded.bits);
        const store::ArchiveLimits limits{static_cast<std::uint64_t>(wanted.frames_mb) * kMegabyte,
                                          static_cast<std::uint64_t>(wanted.free_mb) * kMegabyte};
        const auto open = [folder, limits]() -> Result<std::unique_ptr<store::FrameArchive>> {
            std::error_code ignored;  // the archive reports problems of the folder
            std::filesystem::create_directory(folder, ignored);
            return store::FrameArchive::open(folder / store::kFramesFolder, limits);
        };
        frames = std::make_unique<store::FrameRetention>(
            open, options, store::utc_now,
            store::FrameRetention::Listener{raise(faults, kFaultPictures), clear(faults, kFaultPictures)});
    }

    store::StationRecorderOptions options;
    options.start.boot = recorded.boot;
    options.start.station = config.name;
    options.start.software = recorded.software;
    options.queue.retention.keep_days = wanted.keep_days;
    options.queue.retention.max_bytes = static_cast<std::uint64_t>(wanted.keep_mb) * kMegabyte;
    options.ignored_part = Station::kTestPart;
    store::SqliteStoreOptions disk;
    disk.note = [faults](const Error& note) {
        faults->loop.post([faults, note] {
            if (faults->watchers.trouble) faults->watchers.trouble(note);
        });
    };
    if (frames) {
        // The recorder ends the queue, which has the store, before the frames.
        disk.disk_full = [folder, retention = frames.get()] {
            if (on_one_disk(folder)) retention->make_room_for_results();
        };
    }
    const auto open = [folder, disk] { return store::open_sqlite_store(folder, disk); };
    auto recorder = std::make_unique<store::StationRecorder>(
        loop, store::utc_now, open, std::move(options),
        store::StoreQueue::Listener{raise(faults, kFaultStore), clear(faults, kFaultStore)}, std::move(frames));
    note_configuration(*recorder, config);
    recorder->in_use(store::ChangeRecord::What::recipe, recorded.recipe_name, recorded.recipe);
    return recorder;
}

void note_configuration(store::StationRecorder& recorder, const Config& config) {
    recorder.in_use(store::ChangeRecord::What::configuration, config.file.empty() ? "defaults" : config.file.string(),
                    common::read_file(config.file).value_or(""));
}

}  // namespace hord::firmware
