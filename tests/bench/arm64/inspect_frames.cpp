// Inspects a frame some times by one recipe, without a file format, a clock or a thread: what count_instructions.sh
// counts.
//
// inspect_frames FRAME.raw LENSLETS RECIPES.txt LINE TIMES
//   FRAME.raw    16-bit samples of LENSLETS squared macro-pixels of 9x9 bins, 12 bits
//   RECIPES.txt  one recipe a line: gradient or "none", its limit as EMD, as another gradient, slopes 0 or 1, their
//                limit, light 0 or 1, its limit, the name
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "algo/inspection/pipeline.h"

int main(int argc, char** argv) {
    using namespace hord;
    if (argc != 6) return 2;
    constexpr int kBins = 9, kBits = 12;
    const int lenslets = std::atoi(argv[2]), at = std::atoi(argv[4]), times = std::atoi(argv[5]);
    const algo::Extents extents{lenslets, lenslets, kBins, kBins};
    std::vector<char> samples(static_cast<std::size_t>(extents.width_px()) *
                              static_cast<std::size_t>(extents.height_px()) * 2);
    std::ifstream frame(argv[1], std::ios::binary);
    if (!frame.read(samples.data(), static_cast<std::streamsize>(samples.size()))) return 2;
    std::ifstream recipes(argv[3]);
    std::string line;
    for (int k = 0; k <= at; ++k) {
        if (!std::getline(recipes, line)) return 2;
    }
    std::istringstream words(line);
    std::string gradient;
    algo::Recipe recipe;
    if (!(words >> gradient >> recipe.emd_limit_bins >> recipe.gradient_limit >> recipe.slopes >>
          recipe.frobenius_limit_bins >> recipe.light >> recipe.transmission_limit)) {
        return 2;
    }
    recipe.gradient.reset();
    for (const algo::Feature feature : algo::kJudgedGradients) {
        if (name_of(feature) == gradient) recipe.gradient = feature;
    }
    auto pipeline = algo::Pipeline::create(extents, kBits, recipe);
    if (!pipeline) return std::fprintf(stderr, "%s\n", pipeline.error().message().c_str()), 2;
    const FrameView view{reinterpret_cast<const std::byte*>(samples.data()), extents.width_px(), extents.height_px(),
                         std::ptrdiff_t{2} * extents.width_px(), kBits};
    for (int k = 0; k < times; ++k) {
        const auto found = pipeline->inspect(view);
        if (!found) return std::fprintf(stderr, "%s\n", found.error().message().c_str()), 2;
        std::printf("%s %.4f\n", std::string(name_of(found->verdict)).c_str(), static_cast<double>(found->score));
    }
    return 0;
}
