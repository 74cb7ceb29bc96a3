// Keeps one part of each kind, as the pipeline saw it, for a picture at the end of a run.
#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "firmware/diagnostics/map_images.h"

namespace hord::firmware {

class Gallery {
  public:
    // Bins of a macro-pixel of the frames to come.
    void set_bins(int bins_i, int bins_j) { bins_ = {bins_i, bins_j}; }

    // Any thread. Copies frame and maps of a part until its kind is known; at most kWaiting parts wait. Draws nothing
    // yet, so that the inspection is not held up.
    void keep(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection);
    static constexpr std::size_t kWaiting = 32;

    // The part's kind; kept if it is the first of its kind.
    void settle(std::uint32_t part, const std::string& kind);

    // Writes montage.png into `folder` (made if need be): a row a kind, good first; raw frame, gradient, Frobenius
    // norm, transmission, those that the recipe chooses, each column in one scale. Returns the picture's path. Fails
    // with io, not_found (nothing kept).
    Result<std::string> write(const std::filesystem::path& folder);

  private:
    struct InspectedPart {
        std::uint32_t part = 0;
        algo::Verdict verdict = algo::Verdict::unfit;
        algo::Reason reason = algo::Reason::none;
        algo::Extents extents;
        Frame frame;
        std::optional<algo::Feature> compares;
        std::vector<float> gradient, frobenius, transmission;  // empty: not judged
        std::vector<std::uint8_t> mask;
        std::vector<algo::Defect> defects;
    };
    static MontageRow row(const std::string& kind, const InspectedPart& inspected);

    std::pair<int, int> bins_{9, 9};
    std::mutex mutex_;
    std::map<std::uint32_t, InspectedPart> waiting_;
    std::map<std::string, InspectedPart> kinds_;
};

}  // namespace hord::firmware
