// Creates the recorder for [store] of the configuration.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "drivers/hal/event_loop.h"
#include "firmware/config/config.h"
#include "firmware/station/state_lock.h"
#include "firmware/store/recorder/station_recorder.h"

namespace hord::firmware {

struct Recorded {
    std::string software;
    std::uint32_t boot = 0;
    algo::Extents extents;
    int bits = 8;
    std::string recipe_name, recipe;  // in use at the start: its name and its whole text
};

// Called on the loop's thread.
struct RecordingWatchers {
    std::function<void(const Error&)> trouble;         // to be logged, once
    std::function<void(std::uint32_t faults)> faults;  // kFaultStore and kFaultPictures, as they are now
};

// Takes the lock of the store's folder, which is made unless it exists. The database has a lock of its own, which is
// taken again after each failure; the frames beside it have no lock but this. Fails with busy if another program writes
// there, also if somebody has removed the file of its lock. Holds nothing without a store, and in the state folder,
// whose lock is the same.
Result<StateLock> lock_store(const Config& config);

// "the store's folder /data is in use by process 4711 (hordd)", of the state folder, too. Locks nothing.
std::vector<std::string> folders_in_use(const Config& config);

// Whether `station.lock` in both folders can be a lock. Fails as StateLock::check_file().
Result<void> check_lock_files(const Config& config);

// Told at the start: a store is wanted and has no folder. Empty: it has one, or none is wanted.
std::optional<Error> nothing_is_stored(const Config& config);

// Share of the disk with the store that is free. None: no store is configured, or its folder does not exist (yet).
std::optional<double> store_disk_free_percent(const Config& config);

// How many frames may wait for the disk: store.frame_buffers, limited to 256 MB, but at least the frames kept before a
// reject and two more.
std::size_t frame_buffers(const StoreConfig& config, const algo::Extents& extents, int bits);

// Null without a configured store. A store that cannot be opened does not stop the inspection: it is a fault, reported
// to `watchers`, and opened again every second. `loop` outlives the recorder.
std::unique_ptr<store::StationRecorder> make_recorder(hal::EventLoop& loop, const Config& config,
                                                      const Recorded& recorded, const RecordingWatchers& watchers);

// Records the text of the configuration file if it differs from the store's newest.
void note_configuration(store::StationRecorder& recorder, const Config& config);

}  // namespace hord::firmware
