// Arbitrary text as the JSON in or beside a frame: its geometry note, and the metadata of a kept frame.
#include <cstdlib>

#include "drivers/files/frame_geometry.h"
#include "firmware/store/frames/frame_metadata.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    const std::string text(reinterpret_cast<const char*>(data), size);
    const auto note = drivers::geometry_from_json(text, "note");
    if (!note && note.error().what.find("note") == std::string::npos) std::abort();
    if (note && drivers::geometry_from_json(drivers::to_json(*note), "again") != *note) std::abort();
    const auto metadata = firmware::store::FrameMetadata::from_json(text, "kept");
    if (!metadata && metadata.error().what.find("kept") == std::string::npos) std::abort();
    return 0;
}
