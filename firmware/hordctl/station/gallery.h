// Keeps one part of each kind, with the frame that was inspected, for a picture at the end of a run.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
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

    // Any thread. The recipe of the inspections to come.
    void set_recipe(std::shared_ptr<const algo::Recipe> recipe);

    // Any thread. Copies the frame of a part until its kind is known; at most kWaiting parts wait. Inspects and draws
    // nothing yet, so that the inspection is not held up.
    void keep(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection);
    static constexpr std::size_t kWaiting = 32;

    // Keeps a part if it is the first of its kind. `look`: which of the simulated line's parts it looks like.
    void settle(std::uint32_t part, const std::string& kind, std::size_t look);

    // What an ordinary camera would have seen of a part: one value a lenslet, 1 is the light; empty: unknown.
    using OrdinaryView = std::function<std::vector<float>(std::size_t look)>;

    // Writes montage.png into `folder` (made if need be): a row a kind, good first: the ordinary camera's picture (else
    // the raw frame), the transmission, and the map that decided (another judged one, where the transmission did), each
    // column in one scale. Verdict and reason stand over the map that decided. The frames are inspected again for it,
    // with all maps exact. Returns the picture's path. Fails with io, refused (the picture is a link or device),
    // not_found (nothing kept), and as Pipeline::create() does.
    Result<std::string> write(const std::filesystem::path& folder, const OrdinaryView& ordinary = {});

  private:
    struct InspectedPart {
        std::uint32_t part = 0;
        std::size_t look = 0;
        algo::Verdict verdict = algo::Verdict::unfit;
        algo::Reason reason = algo::Reason::none;
        algo::Extents extents;
        Frame frame;
        std::shared_ptr<const algo::Recipe> recipe;
    };
    static Result<MontageRow> row(const std::string& kind, const InspectedPart& inspected,
                                  const std::vector<float>& ordinary);

    std::pair<int, int> bins_{9, 9};
    std::mutex mutex_;
    std::shared_ptr<const algo::Recipe> recipe_ = std::make_shared<const algo::Recipe>();
    std::map<std::uint32_t, InspectedPart> waiting_;
    std::map<std::string, InspectedPart> kinds_;
};

}  // namespace hord::firmware
