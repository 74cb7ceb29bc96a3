// The recorder that a configuration asks for ([store]): what outlives a run.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "algo/frame/extents.h"
#include "drivers/hal/event_loop.h"
#include "firmware/config/config.h"
#include "firmware/store/recorder/station_recorder.h"

namespace hord::firmware {

struct Recorded {
    std::string software;
    std::uint32_t boot = 0;
    algo::Extents extents;
    int bits = 8;
    std::string recipe_name, recipe;  // in use at the start: its name and its whole text
};

// Told on the loop's thread.
struct RecordingWatchers {
    std::function<void(const Error&)> trouble;         // to be logged, once
    std::function<void(std::uint32_t faults)> faults;  // kFaultStore and kFaultPictures, as they are now
};

// The folder of the store; empty: the configuration asks for none.
std::filesystem::path store_folder(const Config& config);

// How many frames may wait for the disk: store.frame_buffers, or fewer where they are so large that those would take
// more than 256 MB; what is kept before a reject, and two more, always find room.
std::size_t frame_buffers(const StoreConfig& config, const algo::Extents& extents, int bits);

// Null when the configuration asks for no store. A store that cannot be opened is no reason not to judge parts: it is a
// fault, told to `watchers`, and tried again every second. `loop` outlives the recorder.
std::unique_ptr<store::StationRecorder> make_recorder(hal::EventLoop& loop, const Config& config,
                                                      const Recorded& recorded, const RecordingWatchers& watchers);

// Enters the text of the configuration's file where it is not the one that is known.
void note_configuration(store::StationRecorder& recorder, const Config& config);

}  // namespace hord::firmware
