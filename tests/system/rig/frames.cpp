// hord_rig_frames PNG PGM: converts a frame to the PGM format that hord_rig_world reads.
#include <cstdio>
#include <fstream>

#include <fmt/format.h>

#include "drivers/files/frame_file.h"

int main(int argc, char** argv) {
    if (argc != 3) {
        fmt::print(stderr, "usage: hord_rig_frames PNG PGM\n");
        return 2;
    }
    const auto frame = hord::drivers::read_frame(argv[1], {.bits = 8});
    if (!frame) {
        fmt::print(stderr, "hord_rig_frames: {}\n", frame.error().message());
        return 2;
    }
    std::ofstream out(argv[2], std::ios::binary);
    out << fmt::format("P5\n{} {}\n255\n", frame->width_px(), frame->height_px());
    out.write(reinterpret_cast<const char*>(frame->bytes().data()),
              static_cast<std::streamsize>(frame->bytes().size()));
    return out.flush() ? 0 : 2;
}
