// Keeps one part of each kind, as the pipeline saw it, for a picture at the end of a run.
#pragma once

#include <filesystem>
#include <functional>
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

    // Keeps a part if it is the first of its kind.
    // The part's kind, and which of the simulated line's parts it looks like.
    void settle(std::uint32_t part, const std::string& kind, std::size_t look);

    // What an ordinary camera would have seen of a part: one value a lenslet, 1 is the light; empty: unknown.
    using OrdinaryView = std::function<std::vector<float>(std::size_t look)>;

    // Writes montage.png into `folder` (made if need be): a row a kind, good first: the ordinary camera's picture (else
    // the raw frame), the transmission, and the map that decided (the gradient, where the transmission did), those that
    // the recipe chooses, each map in one scale. Verdict and reason are beside the map that decided. Returns the
    // picture's path. Fails with io, not_found (nothing kept).
    Result<std::string> write(const std::filesystem::path& folder, const OrdinaryView& ordinary = {});

  private:
    struct InspectedPart {
        std::uint32_t part = 0;
        std::size_t look = 0;
        algo::Verdict verdict = algo::Verdict::unfit;
        algo::Reason reason = algo::Reason::none;
        algo::Extents extents;
        Frame frame;
        std::optional<algo::Feature> compares;
        std::vector<float> gradient, frobenius, transmission;  // empty: not judged
        std::vector<std::uint8_t> mask;
        std::vector<algo::Defect> defects;
    };
    static MontageRow row(const std::string& kind, const InspectedPart& inspected, const std::vector<float>& ordinary);

    std::pair<int, int> bins_{9, 9};
    std::mutex mutex_;
    std::map<std::uint32_t, InspectedPart> waiting_;
    std::map<std::string, InspectedPart> kinds_;
};

}  // namespace hord::firmware
