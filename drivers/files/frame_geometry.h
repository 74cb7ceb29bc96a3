// The geometry note of a frame's file: what its samples are. Programs that write frames write it, programs that read
// frames compare it with their options, so that a frame is not read with another geometry.
//
// In a PNG the note is an iTXt chunk "hord". Any file may have it in a sidecar: NAME.frame.json beside NAME.tiff,
// NAME.pgm or NAME.png. The text is one JSON object:
//
//     {"schema": 1, "kind": "macro-pixels", "grid": {"m": 111, "n": 111, "i": 9, "j": 9}, "bits": 8}
//     {"schema": 1, "kind": "raw", "bits": 12}
//
// The metadata of a kept frame (firmware/store/frames/frame_metadata.h) is such a note, too. Other keys are ignored.
#pragma once

#include <cstdint>
#include <string>

#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::drivers {

enum class FrameKind : std::uint8_t {
    macro_pixels,  // a lenslet's bins are i x j neighbouring samples (algo/frame/extents.h)
    raw,           // as the sensor saw the lenslet array; hordctl calibrate finds its grid
};

struct FrameGeometry {
    FrameKind kind = FrameKind::macro_pixels;
    algo::Extents grid;  // of macro-pixels; all 0 for a raw frame
    int bits = 8;        // of a sample, 8..16

    friend bool operator==(const FrameGeometry&, const FrameGeometry&) = default;
};

// "macro-pixels of 9x9 bins, 111x111 lenslets, 8 bits"; "a raw frame of 12 bits".
std::string describe(const FrameGeometry& geometry);

// One line.
std::string to_json(const FrameGeometry& geometry);

// Fails with unreadable (not JSON, a key missing or of another type, values that contradict each other or exceed the
// limits), unsupported (another schema). `name`: of the file that holds the text, for the message.
Result<FrameGeometry> geometry_from_json(const std::string& text, const std::string& name);

// Fails with unreadable if the frame has another size or depth than its note says. 9- to 15-bit samples may be in a
// frame of 16 bits.
Result<void> check_against(const FrameGeometry& geometry, const Frame& frame, const std::string& name);

}  // namespace hord::drivers
