// Frames for docs/results/tune.md: tune_frames FOLDER POVRAY writes FOLDER/production/{learn,good,bad} of the simulated
// production of `hord-lab experiment detection`, and FOLDER/povray/{good,bad} from the traced frames in the folder
// POVRAY, with photon noise added. All seeds are fixed.
#include <cstdio>
#include <filesystem>
#include <string>

#include "drivers/files/frame_file.h"
#include "lab/detection/detection_parts.h"
#include "tests/support/frames.h"

namespace {

using namespace hord;
namespace fs = std::filesystem;
constexpr std::uint64_t kSeed = 6;

bool write(const fs::path& folder, const std::string& name, const Frame& frame) {
    fs::create_directories(folder);
    if (const auto done = drivers::write_frame(folder / (name + ".png"), frame.view()); !done)
        return std::fprintf(stderr, "%s\n", done.error().message().c_str()), false;
    return true;
}

// 60 good parts with slightly different poses; 24 with haze (a tenth of the light scattered over 1.2 lenslets), 24
// with a bubble of 0.1 to 1.5 lenslets, 12 with a speck; 16 other good ones to learn from.
bool production(const fs::path& folder) {
    const sim::Scene scene = lab::round_part();
    const auto part = [&](const char* kind, const std::string& name, lab::Flaw flaw, double size, lab::Stream stream,
                          std::uint32_t number) {
        const bool painted = flaw == lab::Flaw::haze || flaw == lab::Flaw::speck;
        auto made = lab::make_part(scene, painted ? lab::Flaw::none : flaw, size, 1, kSeed, stream, number);
        if (!made) return std::fprintf(stderr, "%s\n", made.error().message().c_str()), false;
        if (painted) lab::add_flaw(*made, flaw, size, kSeed, stream, number);
        return write(folder / kind, name + std::to_string(100 + number % 100),
                     lab::expose_part(made->light, scene, kSeed, number + 1000 * static_cast<std::uint64_t>(stream)));
    };
    bool fine = true;
    for (std::uint32_t k = 0; k < 16; ++k)
        fine = fine && part("learn", "part", lab::Flaw::none, 0, lab::Stream::learn, k);
    for (std::uint32_t k = 0; k < 60; ++k)
        fine = fine && part("good", "part", lab::Flaw::none, 0, lab::Stream::test, k);
    for (std::uint32_t k = 0; k < 24; ++k)
        fine = fine && part("bad", "haze", lab::Flaw::haze, 1.2, lab::Stream::test, 100 + k);
    for (std::uint32_t k = 0; k < 24; ++k)
        fine = fine && part("bad", "bubble", lab::Flaw::bubble, 0, lab::Stream::test, 200 + k);
    for (std::uint32_t k = 0; k < 12; ++k)
        fine = fine && part("bad", "speck", lab::Flaw::speck, 1, lab::Stream::test, 300 + k);
    return fine;
}

// The lens in 22 poses, and with five flaws, four exposures each; about 10,000 electrons in a bin filled by the source
// (a DN of these 16-bit frames is a quarter of an electron).
bool povray(const fs::path& folder, const fs::path& from) {
    const algo::testing::Noise noise{0.25, 2, 1};
    std::uint64_t seed = kSeed;
    const auto expose = [&](const char* kind, const std::string& scene, int count) {
        const auto traced = drivers::read_frame(from / (scene + "_raw.png"));
        if (!traced) return std::fprintf(stderr, "%s\n", traced.error().message().c_str()), false;
        bool fine = true;
        for (int k = 0; k < count; ++k) {
            const auto frame = algo::testing::noisy(*traced, noise, ++seed);
            fine = fine && write(folder / kind, scene + "_" + std::to_string(k), frame);
        }
        return fine;
    };
    bool fine = true;
    for (int pose = 100; pose < 122; ++pose)
        fine = fine && expose("good", "lens_pose" + std::to_string(pose).substr(1), 1);
    for (const char* flaw : {"bubble035", "bubble070", "cut0", "scratch1", "speck050"})
        fine = fine && expose("bad", std::string("lens_") + flaw, 4);
    return fine;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 3) return std::fprintf(stderr, "tune_frames FOLDER POVRAY\n"), 2;
    return production(fs::path(argv[1]) / "production") && povray(fs::path(argv[1]) / "povray", argv[2]) ? 0 : 1;
}
