#include "lab/reference/light_fields.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <numbers>
#include <random>

#include <nlohmann/json.hpp>

#include "drivers/files/frame_file.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::lab {
namespace {

using namespace nlohmann::literals;

constexpr std::string_view kSuffix = "_raw.png";

Result<TracedPart> read_part(const std::filesystem::path& picture, const std::string& name) {
    const auto notes = picture.parent_path() / (name + ".json");
    const auto refuse = [&](const std::string& why) {
        return fail(ErrorCode::unreadable, notes.string() + ": " + why, "see lab/reference/light_fields.h");
    };
    std::ifstream stream(notes);
    const auto json = nlohmann::json::parse(stream, nullptr, false);
    if (!json.is_object()) return refuse("is not a JSON object");
    TracedPart part;
    part.name = name, part.family = json.value("part", "");
    const auto frame = drivers::read_frame(picture, {0, 0, 16});
    if (!frame) return tl::unexpected(frame.error());
    const int bins = std::max(1, json.value("angular", 9));
    part.extents = {frame->width_px() / bins, frame->height_px() / bins, bins, bins};
    if (part.extents.width_px() != frame->width_px() || part.extents.height_px() != frame->height_px())
        return refuse("its picture has no whole number of lenslets");
    if (auto fine = check(part.extents); !fine) return refuse(fine.error().what);
    if (!json.value("defect_free", false)) {
        const auto centre = json.find("centre_lenslet"), radius = json.find("radius_lenslets");
        if (centre == json.end() || !centre->is_array() || centre->size() != 2 || !(*centre)[0].is_number() ||
            !(*centre)[1].is_number())
            return refuse("centre_lenslet is not two numbers");
        part.flaw = TracedFlaw{(*centre)[0].get<double>(), (*centre)[1].get<double>(), std::nullopt};
        if (radius != json.end() && radius->is_number()) part.flaw->radius = radius->get<double>();
        const auto length = json.find("length_lenslets");
        if (length != json.end() && length->is_number()) {
            part.flaw->length = length->get<double>();
            part.flaw->angle = json.value("/defect/deg"_json_pointer, 0.0) * std::numbers::pi / 180;
        }
    }
    for (int y = 0; y < frame->height_px(); ++y) {
        for (int x = 0; x < frame->width_px(); ++x)
            part.light.push_back(static_cast<float>(frame->view().sample(x, y) / kFilledBin));
    }
    return part;
}

}  // namespace

double TracedFlaw::distance(double at_m, double at_n) const {
    const double x = at_m - m, y = at_n - n, c = std::cos(angle), s = std::sin(angle);
    const double beyond = std::max(0.0, std::abs(c * x + s * y) - length / 2);
    return std::hypot(beyond, c * y - s * x);
}

Result<std::map<std::string, TracedFamily>> read_light_fields(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> pictures;
    std::error_code error;
    for (auto entry = std::filesystem::directory_iterator(folder, error);
         !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
        if (entry->path().filename().string().ends_with(kSuffix)) pictures.push_back(entry->path());
    }
    if (pictures.empty())
        return fail(ErrorCode::not_found, folder.string() + " has no light fields",
                    "give --frames a folder with NAME_raw.png and NAME.json");
    std::ranges::sort(pictures);
    std::map<std::string, TracedFamily> families;
    for (const auto& picture : pictures) {
        std::string name = picture.filename().string();
        name.resize(name.size() - kSuffix.size());
        auto part = read_part(picture, name);
        if (!part) return tl::unexpected(part.error());
        TracedFamily& family = families[part->family];
        (part->flaw ? family.flawed : family.good).push_back(std::move(*part));
    }
    return families;
}

double electrons_per_dn(const Exposure& exposure) {
    return exposure.electrons / (240.0 / 255 * ((1 << exposure.bits) - 1));
}

Frame expose(const TracedPart& part, const Exposure& exposure) {
    sim::Scene scene;
    scene.camera.bits = exposure.bits;
    scene.noise.electrons_per_dn = electrons_per_dn(exposure);
    scene.noise.read_e = kReadElectrons;
    scene.camera.full_bin_dn = exposure.electrons / scene.noise.electrons_per_dn;
    const algo::Extents& e = part.extents;
    std::vector<float> light = part.light;
    if (exposure.ripple != Ripple::none) {
        std::mt19937_64 random(exposure.ripple == Ripple::sensor ? 1 : std::hash<std::string>{}(part.name));
        std::normal_distribution<float> gain(1, static_cast<float>(kRippleShare));
        std::vector<float> gains(e.lenslets());
        for (float& g : gains) g = gain(random);
        for (std::size_t k = 0; k < light.size(); ++k) {
            const int x = static_cast<int>(k) % e.width_px(), y = static_cast<int>(k) / e.width_px();
            light[k] *= gains[e.index(x / e.i, y / e.j)];
        }
    }
    return sim::expose(light, e.width_px(), e.height_px(), scene, exposure.seed, exposure.light);
}

}  // namespace hord::lab
