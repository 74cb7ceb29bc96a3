#include "firmware/hordctl/station/gallery.h"

#include <algorithm>

#include <fmt/format.h>

#include "common/cli/program.h"

namespace hord::firmware {
namespace {

// One scale a column, so that rows can be compared; deflections beyond it take the end colour.
constexpr float kShareHigh = 1, kTransmissionHigh = 1.2F;

// `otherwise`: of a feature without a fixed scale.
float high_of(const FeatureView& view, float otherwise) {
    if (view.name == name_of(algo::Feature::transmission)) return kTransmissionHigh;
    if (view.unit.starts_with("bin pitches") && view.limit > 0) return 2 * view.limit;
    const auto choice = algo::feature_named(view.name);
    return choice && algo::is_judged_gradient(choice->feature) ? kShareHigh : otherwise;
}

}  // namespace

void Gallery::set_recipe(std::shared_ptr<const algo::Recipe> recipe) {
    const std::lock_guard lock(mutex_);
    recipe_ = std::move(recipe);
}

void Gallery::keep(std::uint32_t part, const FrameView& view, const algo::Inspection& found) {
    InspectedPart inspected{part,
                            0,
                            found.verdict,
                            found.reason,
                            {view.width_px / bins_.first, view.height_px / bins_.second, bins_.first, bins_.second},
                            Frame(view.width_px, view.height_px, view.bits),
                            nullptr};
    const auto row_bytes = static_cast<std::size_t>(view.width_px * view.sample_bytes());
    for (int y = 0; y < view.height_px; ++y) {
        std::copy_n(view.data + y * view.stride_bytes, row_bytes,
                    inspected.frame.bytes().begin() + static_cast<std::ptrdiff_t>(row_bytes) * y);
    }
    const std::lock_guard lock(mutex_);
    inspected.recipe = recipe_;
    if (waiting_.size() >= kWaiting) waiting_.erase(waiting_.begin());
    waiting_[part] = std::move(inspected);
}

Result<MontageRow> Gallery::row(const std::string& kind, const InspectedPart& inspected,
                                const std::vector<float>& ordinary) {
    const algo::Extents& e = inspected.extents;
    auto pipeline = algo::Pipeline::create(e, inspected.frame.view().bits, *inspected.recipe, 1, algo::MapSet::all);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto found = pipeline->inspect(inspected.frame.view());
    if (!found) return tl::unexpected(found.error());
    const FeatureViews views(*found, *inspected.recipe, e);
    const std::string verdict = fmt::format(
        "part {}: {}{}", inspected.part, name_of(inspected.verdict),
        inspected.reason == algo::Reason::none ? std::string() : fmt::format(", {}", name_of(inspected.reason)));
    std::vector<Picture> pictures;
    if (ordinary.size() == e.lenslets()) {
        const std::vector<std::uint8_t> everywhere(e.lenslets(), algo::kValid);
        pictures.push_back(
            draw({"telecentric camera", "of the light", 0, kTransmissionHigh}, ordinary, everywhere, e, {}));
    } else {
        pictures.push_back(draw("raw frame", inspected.frame.view(), e));
    }
    const FeatureView& deciding = views.deciding();
    const auto add = [&](const FeatureView& view) {
        const bool decided = view.name == deciding.name;
        MapPicture picture = scale_to(decided ? view.title + ": " + verdict : view.title, view, *inspected.recipe);
        picture.low = 0;
        picture.high = high_of(view, picture.high);
        pictures.push_back(draw(picture, view.map, view.mask, e, found->defects));
    };
    const FeatureView* const transmission = views.find(name_of(algo::Feature::transmission));
    if (transmission != nullptr) add(*transmission);
    if (transmission == nullptr || deciding.name != transmission->name) add(deciding);
    else if (const FeatureView& other = views.judged().front(); other.name != deciding.name) add(other);
    return MontageRow{kind, std::move(pictures)};
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
    for (const bool good : {true, false}) {
        for (const auto& [kind, inspected] : kinds_) {
            if ((kind == "good") != good) continue;
            auto drawn = row(kind, inspected, ordinary ? ordinary(inspected.look) : std::vector<float>());
            if (!drawn) return tl::unexpected(drawn.error());
            rows.push_back(std::move(*drawn));
        }
    }
    const auto file = folder / "montage.png";
    if (auto done = write_png(file, halved(montage(rows))); !done) return tl::unexpected(done.error());
    return file.string();
}

}  // namespace hord::firmware
