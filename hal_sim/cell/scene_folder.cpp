#include "hal_sim/cell/scene_folder.h"

#include <algorithm>
#include <cctype>

namespace hord::sim {
namespace {

// "bubble" of "bubble-12".
std::string kind_of(std::string stem) {
    const std::size_t dash = stem.find_last_of('-');
    if (dash == std::string::npos || dash == 0 || dash + 1 == stem.size()) return stem;
    const bool number = std::all_of(stem.begin() + static_cast<std::ptrdiff_t>(dash) + 1, stem.end(),
                                    [](unsigned char c) { return std::isdigit(c) != 0; });
    return number ? stem.substr(0, dash) : stem;
}

}  // namespace

Result<Production> load_production(const std::filesystem::path& folder, double good_share) {
    std::error_code error;
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        if (entry.path().extension() == ".toml") files.push_back(entry.path());
    }
    if (error || files.empty()) {
        return fail(ErrorCode::not_found,
                    folder.string() + (error ? " cannot be read (" + error.message() + ")" : " has no scene"),
                    "name a folder of scene files (docs/scene.md), one part each: good-1.toml, bubble-1.toml");
    }
    std::ranges::sort(files);
    Production production;
    for (const auto& file : files) {
        auto scene = load_scene(file);
        if (!scene) return tl::unexpected(scene.error());
        if (!production.scenes.empty() && scene->camera.extents != production.scenes.front().camera.extents) {
            return fail(ErrorCode::invalid_argument,
                        file.string() + " has another camera than " + files.front().filename().string(),
                        "give all scenes of a cell the same [camera]");
        }
        const std::string kind = kind_of(file.stem().string());
        production.kinds.push_back({kind, kind != name_of(PartClass::good), 1});
        production.scenes.push_back(std::move(*scene));
    }
    const auto bad = static_cast<double>(std::ranges::count_if(production.kinds, &PartKind::bad));
    const double good = static_cast<double>(production.kinds.size()) - bad;
    if (good > 0 && bad > 0) {
        for (PartKind& kind : production.kinds) kind.share = kind.bad ? (1 - good_share) / bad : good_share / good;
    }
    return production;
}

}  // namespace hord::sim
