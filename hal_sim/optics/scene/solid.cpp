#include "hal_sim/optics/scene/solid.h"

#include <algorithm>

namespace hord::sim {

bool Solid::contains(std::uint64_t state) const {
    switch (op_) {
        case Op::surface: return ((state >> surface_) & 1U) != 0;
        case Op::all: return std::all_of(of_.begin(), of_.end(), [&](const Solid& s) { return s.contains(state); });
        case Op::any: return std::any_of(of_.begin(), of_.end(), [&](const Solid& s) { return s.contains(state); });
        case Op::difference: return of_[0].contains(state) && !of_[1].contains(state);
    }
    return false;
}

int Body::add(const Surface& surface) {
    if (static_cast<int>(surfaces.size()) == kMaxSurfaces) return -1;
    surfaces.push_back(surface);
    return static_cast<int>(surfaces.size()) - 1;
}

void Body::fill(Solid part, double index) {
    solids_.insert(solids_.begin(), std::move(part));
    indices_.insert(indices_.begin() + 1, index);
    absorptions_.insert(absorptions_.begin() + 1, 0.0);
    empty = false;
}

void Body::tint(double absorption) {
    if (empty || !(absorption > 0)) return;
    absorptions_[1] = absorption;
    absorbs = true;
}

void Body::fill_more(Solid defect, double index, double absorption) {
    solids_.push_back(std::move(defect));
    indices_.push_back(index);
    absorptions_.push_back(absorption);
    absorbs = absorbs || absorption > 0;
}

void Body::move(const Rigid& by) {
    for (Surface& surface : surfaces) surface.point = by(surface.point), surface.axis = by.turn(surface.axis);
    for (Disc& disc : discs) disc.centre = by(disc.centre);
    for (Feature& feature : features) feature.from = by(feature.from), feature.to = by(feature.to);
    const Vec3 middle = by(0.5 * (low + high)), half = 0.5 * (high - low);
    double flat = 0;  // discs turn back into the plane across the light
    for (const Disc& disc : discs) flat = std::max(flat, disc.radius);
    const Vec3 reach{std::abs(by.x.x) * half.x + std::abs(by.y.x) * half.y + std::abs(by.z.x) * half.z + flat,
                     std::abs(by.x.y) * half.x + std::abs(by.y.y) * half.y + std::abs(by.z.y) * half.z + flat,
                     std::abs(by.x.z) * half.x + std::abs(by.y.z) * half.y + std::abs(by.z.z) * half.z + flat};
    low = middle - reach, high = middle + reach;
}

void Body::done() {
    size = length(high - low);
    for (const Surface& surface : surfaces) size = std::max(size, surface.radius);
    constexpr std::size_t kTabulated = 12;
    if (surfaces.size() > kTabulated) return;
    std::vector<std::uint8_t> table(std::size_t{1} << surfaces.size());
    for (std::size_t state = 0; state < table.size(); ++state) table[state] = work_out(state);
    table_ = std::move(table);
}

std::uint8_t Body::work_out(std::uint64_t state) const {
    if (solids_.empty() || !solids_[0].contains(state)) return 0;
    for (std::size_t k = solids_.size(); k-- > 1;) {
        if (solids_[k].contains(state)) return static_cast<std::uint8_t>(k + 1);
    }
    return 1;
}

}  // namespace hord::sim
