// Writes parts of the real frames for map_checksum: raw_frames OUT. Skips frames that are missing.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <opencv2/imgcodecs.hpp>

namespace {

void write_part(const std::filesystem::path& from, const std::filesystem::path& to, int first_row, int rows) {
    std::error_code error;
    std::filesystem::remove(to, error);
    const cv::Mat image = cv::imread(from.string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) {
        std::printf("%s is not there: set HORD_DATA, or put it at ../shared/data\n", from.c_str());
        return;
    }
    std::ofstream file(to, std::ios::binary);
    const std::uint32_t size[2] = {static_cast<std::uint32_t>(image.cols / 9), static_cast<std::uint32_t>(rows)};
    file.write(reinterpret_cast<const char*>(size), sizeof size);
    for (int y = first_row * 9; y < (first_row + rows) * 9; ++y)
        file.write(reinterpret_cast<const char*>(image.ptr(y)), image.cols / 9 * 9);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const char* given = std::getenv("HORD_DATA");
    const std::filesystem::path data = given != nullptr ? std::filesystem::path(given)
                                                        : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data",
                                out = argv[1];
    write_part(data / "bench/frame_555_9x9.png", out / "frame_555_part.raw", 250, 8);
    write_part(data / "povray/bubble_r500_111_raw.png", out / "bubble_part.raw", 40, 24);
}
