#include "firmware/hordctl/station/gallery.h"

#include <algorithm>

#include <fmt/format.h>

#include "common/cli/program.h"

namespace hord::firmware {
namespace {

// One scale a column, so that rows can be compared; deflections beyond it take the end colour.
constexpr float kBinsHigh = 2, kShareHigh = 1, kFrobeniusHigh = 0.8F, kTransmissionHigh = 1.2F;

}  // namespace

void Gallery::keep(std::uint32_t part, const FrameView& view, const algo::Inspection& found) {
    InspectedPart inspected{part,
                            0,
                            found.verdict,
                            found.reason,
                            {view.width_px / bins_.first, view.height_px / bins_.second, bins_.first, bins_.second},
                            Frame(view.width_px, view.height_px, view.bits),
                            found.compares,
                            {found.gradient.begin(), found.gradient.end()},
                            {found.frobenius.begin(), found.frobenius.end()},
                            {found.transmission.begin(), found.transmission.end()},
                            {found.mask.begin(), found.mask.end()},
                            {found.defects.begin(), found.defects.end()}};
    const auto row_bytes = static_cast<std::size_t>(view.width_px * view.sample_bytes());
    for (int y = 0; y < view.height_px; ++y) {
        std::copy_n(view.data + y * view.stride_bytes, row_bytes,
                    inspected.frame.bytes().begin() + static_cast<std::ptrdiff_t>(row_bytes) * y);
    }
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= kWaiting) waiting_.erase(waiting_.begin());
    waiting_[part] = std::move(inspected);
}

MontageRow Gallery::row(const std::string& kind, const InspectedPart& inspected, const std::vector<float>& ordinary) {
    using algo::Reason;
    const algo::Extents& e = inspected.extents;
    const std::string verdict =
        fmt::format("part {}: {}{}", inspected.part, name_of(inspected.verdict),
                    inspected.reason == Reason::none ? std::string() : fmt::format(", {}", name_of(inspected.reason)));
    std::vector<Picture> pictures;
    if (ordinary.size() == e.lenslets()) {
        const std::vector<std::uint8_t> everywhere(e.lenslets(), algo::kValid);
        pictures.push_back(
            draw({"telecentric camera", "of the light", 0, kTransmissionHigh}, ordinary, everywhere, e, {}));
    } else {
        pictures.push_back(draw("raw frame", inspected.frame.view(), e));
    }

    const bool by_light = inspected.reason == Reason::absorption && !inspected.transmission.empty();
    const bool by_slope =
        !inspected.frobenius.empty() && (inspected.reason == Reason::deflection_gradient || inspected.gradient.empty());
    const auto add = [&](MapPicture what, const std::vector<float>& map, bool decided) {
        if (map.empty()) return;
        if (decided) what.title += ": " + verdict;
        pictures.push_back(draw(what, map, inspected.mask, e, inspected.defects));
    };
    add({"transmission", "of typical", 0, kTransmissionHigh}, inspected.transmission, by_light);
    if (by_slope) {
        add({"Jacobian norm", "bins a lenslet", 0, kFrobeniusHigh}, inspected.frobenius, !by_light);
    } else if (inspected.compares == algo::Feature::emd) {
        add({"EMD gradient", "bins", 0, kBinsHigh}, inspected.gradient, !by_light);
    } else if (inspected.compares) {
        const bool in_bins = !algo::unit_of(*inspected.compares).empty();
        add({std::string(name_of(*inspected.compares)) + " gradient", in_bins ? "bins" : "", 0,
             in_bins ? kBinsHigh : kShareHigh},
            inspected.gradient, !by_light);
    }
    return {kind, std::move(pictures)};
}

void Gallery::settle(std::uint32_t part, const std::string& kind, std::size_t look) {
    const std::lock_guard lock(mutex_);
    const auto found = waiting_.find(part);
    if (found == waiting_.end()) return;
    found->second.look = look;
    kinds_.try_emplace(kind.empty() ? "part" : kind, std::move(found->second));
    waiting_.erase(found);
}

Result<std::string> Gallery::write(const std::filesystem::path& folder, const OrdinaryView& ordinary) {
    const std::lock_guard lock(mutex_);
    if (kinds_.empty())
        return fail(ErrorCode::not_found, "no part was inspected, so there is no picture of one",
                    "see the messages above");
    if (auto made = make_folder(folder); !made) return tl::unexpected(made.error());
    std::vector<MontageRow> rows;
    const auto add = [&](const std::string& kind, const InspectedPart& inspected) {
        rows.push_back(row(kind, inspected, ordinary ? ordinary(inspected.look) : std::vector<float>()));
    };
    if (const auto good = kinds_.find("good"); good != kinds_.end()) add("good", good->second);
    for (const auto& [kind, inspected] : kinds_) {
        if (kind != "good") add(kind, inspected);
    }
    const auto file = folder / "montage.png";
    if (auto done = write_png(file, montage(rows)); !done) return tl::unexpected(done.error());
    return file.string();
}

}  // namespace hord::firmware
