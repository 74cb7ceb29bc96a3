// The true positions of the defects, by tracing light forwards through the part without them.
#include "lab/optics/truth.h"

#include <algorithm>
#include <cmath>

#include "hal_sim/optics/camera/camera.h"

namespace hord::lab {
namespace {

using namespace sim;

enum Seen : std::uint8_t { kFree = 1, kThroughPart = 2, kOddWay = 4 };

// The light that would meet a defect.
bool meets(const RayPolyline& way, const Vec3& centre, double radius, bool only_in_part) {
    for (int k = 1; k < way.count; ++k) {
        if (only_in_part && !way.in_part[k]) continue;
        if (distance_to_segment(centre, way.points[k - 1], way.points[k]) < radius) return true;
    }
    return false;
}
bool meets(const RayPolyline& way, const AirBubble& d) { return meets(way, d.centre_mm, d.radius_mm, true); }
bool meets(const RayPolyline& way, const SphericalCut& d) { return meets(way, d.centre_mm, d.radius_mm, true); }
bool meets(const RayPolyline& way, const Dimple& d) { return meets(way, d.centre_mm, d.radius_mm, true); }
bool meets(const RayPolyline& way, const AbsorbingSpeck& d) {
    for (int k = 1; k < way.count; ++k) {
        const Vec3& a = way.points[k - 1];
        const Vec3& b = way.points[k];
        const double t = (d.centre_mm.z - a.z) / (b.z - a.z);
        if (!(t >= 0 && t < 1)) continue;
        const double x = a.x + t * (b.x - a.x) - d.centre_mm.x, y = a.y + t * (b.y - a.y) - d.centre_mm.y;
        if (x * x + y * y < d.radius_mm * d.radius_mm) return true;
    }
    return false;
}
bool meets(const RayPolyline& way, const Haze& d) { return meets(way, AbsorbingSpeck{d.centre_mm, d.radius_mm}); }

bool meets(const RayPolyline& way, const Inclusion& d) { return meets(way, d.centre_mm, d.radius_mm, true); }
bool meets(const RayPolyline& way, const Absorber& d) { return meets(way, d.centre_mm, d.radius_mm, true); }
template <class Thread>
requires requires(const Thread& d) { d.from_mm; }
bool meets(const RayPolyline& way, const Thread& d) {
    const double span = length(d.to_mm - d.from_mm);
    for (int k = 1; k < way.count; ++k) {
        if (!way.in_part[k]) continue;
        // The stretch's closest approach to the line: both are straight, so the distance along the scratch is convex.
        double low = 0, high = 1;
        const auto at = [&](double t) {
            return distance_to_segment(d.from_mm + t * (d.to_mm - d.from_mm), way.points[k - 1], way.points[k]);
        };
        while ((high - low) * span > 1e-3 * d.radius_mm) {
            const double a = low + (high - low) / 3, b = high - (high - low) / 3;
            (at(a) < at(b) ? high : low) = at(a) < at(b) ? b : a;
        }
        if (at(0.5 * (low + high)) < d.radius_mm) return true;
    }
    return false;
}

struct Around {
    Vec3 centre;
    double reach;   // all of it lies within this distance
    double detail;  // its smallest dimension
};
template <class Ball>
requires requires(const Ball& d) { d.centre_mm; }
Around around(const Ball& d) { return {d.centre_mm, d.radius_mm, d.radius_mm}; }
template <class Thread>
requires requires(const Thread& d) { d.from_mm; }
Around around(const Thread& d) {
    return {0.5 * (d.from_mm + d.to_mm), 0.5 * length(d.to_mm - d.from_mm) + d.radius_mm, d.radius_mm};
}

// A defect, moved by the pose's tilts and its shift along the light. (The rest of the pose is the camera's view:
// camera.h.)
template <class Defect>
Defect posed(Defect defect, const Pose& pose) {
    const Rigid by = Rigid::of({0, 0, pose.z_mm}, {pose.tilt_x_rad, pose.tilt_y_rad, 0});
    if constexpr (requires { defect.centre_mm; }) defect.centre_mm = by(defect.centre_mm);
    else defect.from_mm = by(defect.from_mm), defect.to_mm = by(defect.to_mm);
    return defect;
}

// Largest distance of the array's lenslets from the axis on the measurement plane, mm.
ArrayGeometry::Point reach_of(const CameraGeometry& camera, const algo::Extents& e) {
    const ArrayGeometry& array = camera.array();
    if (array.is_plain()) return {0.5 * e.m * camera.pitch_mm(), 0.5 * e.n * camera.pitch_mm()};
    ArrayGeometry::Point reach;
    for (const int m : {0, e.m - 1}) {
        for (const int n : {0, e.n - 1}) {
            const ArrayGeometry::Point at = array.place_mm(m, n);
            reach.x = std::max(reach.x, std::abs(at.x)), reach.y = std::max(reach.y, std::abs(at.y));
        }
    }
    return {reach.x + camera.pitch_mm(), reach.y + camera.pitch_mm()};
}

// A position of the part's frame, in lenslets: integers are lenslets' centres.
ArrayGeometry::Point lenslet_of(const CameraGeometry& camera, const algo::Extents& e, double x, double y) {
    double x_mm = 0, y_mm = 0;
    camera.position_to_camera(x, y, x_mm, y_mm);
    if (!camera.array().is_plain()) return camera.array().to_lattice({x_mm, y_mm});
    return {x_mm / camera.pitch_mm() + 0.5 * (e.m - 1), y_mm / camera.pitch_mm() + 0.5 * (e.n - 1)};
}

class Labels {
  public:
    Labels(const Scene& scene, const Body& clean)
        : extents_(scene.camera.extents), camera_(scene), clean_(clean), seen_(extents_.lenslets()),
          balance_(extents_.lenslets()), touched_(extents_.lenslets()) {}

    // Traces `per_side` squared rays a lenslet through the whole field, and counts for each lenslet the paths of its
    // rays.
    void survey(int per_side) {
        const double pitch = camera_.pitch_mm() / per_side;
        const int margin = per_side * (2 + extents_.m / 16);  // light may come in from beyond the field
        const ArrayGeometry::Point reach = reach_of(camera_, extents_);
        const int columns = static_cast<int>(std::ceil(2 * reach.x / pitch - 1e-6)),
                  rows = static_cast<int>(std::ceil(2 * reach.y / pitch - 1e-6));
        struct Ray {
            std::size_t lenslet;
            std::uint64_t path;
        };
        std::vector<Ray> through;
        std::vector<std::uint64_t> paths;
        for (int b = -margin; b < rows + margin; ++b) {
            for (int a = -margin; a < columns + margin; ++a) {
                const CameraRay from =
                    camera_.to_part((a + 0.5 - 0.5 * columns) * pitch, (b + 0.5 - 0.5 * rows) * pitch, 0, 0);
                const Landing landing = shine(clean_, from.x, from.y);
                std::size_t at = 0;
                if (landing.path == 0 || !lenslet_at(landing, at)) continue;
                balance_[at] += landing.path == kFreePath ? -1 : 1;
                if (landing.path == kFreePath) seen_[at] |= kFree;
                else through.push_back({at, landing.path}), paths.push_back(landing.path);
            }
        }
        // Most of the light takes the path through the part; other paths belong to side walls.
        std::sort(paths.begin(), paths.end());
        std::uint64_t usual = 0;
        std::size_t most = 0;
        for (std::size_t k = 0; k < paths.size();) {
            const auto end =
                static_cast<std::size_t>(std::upper_bound(paths.begin(), paths.end(), paths[k]) - paths.begin());
            if (end - k > most) most = end - k, usual = paths[k];
            k = end;
        }
        for (const Ray& ray : through) seen_[ray.lenslet] |= ray.path == usual ? kThroughPart : kOddWay;
    }

    // Traces dense rays around one defect. Area 0 when none meets it.
    template <class Defect>
    TruthDefect look_at(const Defect& defect) {
        const auto [centre, reach, detail] = around(defect);
        const double step = std::min(camera_.pitch_mm() / 8, std::max(detail / 12, reach / 300));
        const Vec3 aim = aim_at(centre);
        const int half = static_cast<int>(std::ceil(1.3 * reach / step));
        TruthDefect found;
        std::vector<std::size_t> lenslets;
        double sum_m = 0, sum_n = 0, count = 0;
        for (int b = -half; b <= half; ++b) {
            for (int a = -half; a <= half; ++a) {
                RayPolyline way;
                const Landing landing = shine(clean_, aim.x + a * step, aim.y + b * step, &way);
                if (landing.path == 0 || !meets(way, defect)) continue;
                const ArrayGeometry::Point place = lenslet_of(camera_, extents_, landing.x, landing.y);
                sum_m += place.x, sum_n += place.y, count += 1;
                std::size_t at = 0;
                if (lenslet_at(landing, at)) lenslets.push_back(at);
            }
        }
        std::sort(lenslets.begin(), lenslets.end());
        lenslets.erase(std::unique(lenslets.begin(), lenslets.end()), lenslets.end());
        for (const std::size_t at : lenslets) touched_[at] = 1;
        found.area_lenslets = static_cast<std::uint32_t>(lenslets.size());
        if (count > 0) {
            found.m = sum_m / count, found.n = sum_n / count;
            const double step_lenslets = step / camera_.pitch_mm();
            found.radius_lenslets = std::sqrt(count * step_lenslets * step_lenslets / 3.14159265358979323846);
        }
        return found;
    }

    [[nodiscard]] std::vector<std::uint8_t> labels(int border_width) const {
        const int m_count = extents_.m, n_count = extents_.n;
        const auto at = [&](int m, int n) {
            return static_cast<std::size_t>(n) * static_cast<std::size_t>(m_count) + static_cast<std::size_t>(m);
        };
        const auto is_part = [&](std::size_t k) { return balance_[k] > 0; };  // most of the light
        std::vector<std::uint8_t> border(extents_.lenslets());
        for (int n = 0; n < n_count; ++n) {
            for (int m = 0; m < m_count; ++m) {
                const std::size_t k = at(m, n);
                bool is_border = seen_[k] != kFree && seen_[k] != kThroughPart;  // mixed, odd, or dark
                if (m > 0) is_border = is_border || is_part(k) != is_part(at(m - 1, n));
                if (m + 1 < m_count) is_border = is_border || is_part(k) != is_part(at(m + 1, n));
                if (n > 0) is_border = is_border || is_part(k) != is_part(at(m, n - 1));
                if (n + 1 < n_count) is_border = is_border || is_part(k) != is_part(at(m, n + 1));
                if (!is_border) continue;
                for (int b = std::max(0, n - border_width); b <= std::min(n_count - 1, n + border_width); ++b) {
                    for (int a = std::max(0, m - border_width); a <= std::min(m_count - 1, m + border_width); ++a)
                        border[at(a, b)] = 1;
                }
            }
        }
        std::vector<std::uint8_t> out(extents_.lenslets());
        for (std::size_t k = 0; k < out.size(); ++k) {
            const bool is_defect = touched_[k] != 0;
            out[k] = static_cast<std::uint8_t>(is_defect ? (border[k] ? 4 : 3) : border[k] ? 2 : is_part(k) ? 1 : 0);
        }
        return out;
    }

  private:
    // Where a ray must start to pass `place` in spite of its deflection: three fixed-point iterations.
    [[nodiscard]] Vec3 aim_at(const Vec3& place) const {
        Vec3 aim = place;
        for (int step = 0; step < 3; ++step) {
            RayPolyline way;
            shine(clean_, aim.x, aim.y, &way);
            for (int k = 1; k < way.count; ++k) {
                const Vec3& a = way.points[k - 1];
                const Vec3& b = way.points[k];
                if (!(a.z <= place.z && place.z < b.z)) continue;
                const double t = (place.z - a.z) / (b.z - a.z);
                aim.x -= a.x + t * (b.x - a.x) - place.x;
                aim.y -= a.y + t * (b.y - a.y) - place.y;
                break;
            }
        }
        return aim;
    }

    bool lenslet_at(const Landing& landing, std::size_t& at) const {
        const ArrayGeometry::Point place = lenslet_of(camera_, extents_, landing.x, landing.y);
        const double column = std::floor(place.x + 0.5), row = std::floor(place.y + 0.5);
        if (!(column >= 0 && column < extents_.m && row >= 0 && row < extents_.n)) return false;
        at = static_cast<std::size_t>(row) * static_cast<std::size_t>(extents_.m) + static_cast<std::size_t>(column);
        return true;
    }

    algo::Extents extents_;
    CameraGeometry camera_;
    const Body& clean_;
    std::vector<std::uint8_t> seen_;
    std::vector<int> balance_;  // rays through the part, less free ones
    std::vector<std::uint8_t> touched_;
};

}  // namespace

Truth truth_of(const Scene& scene) {
    Body clean = body_of(scene, false);
    const Body whole = body_of(scene, true);
    clean.low = whole.low, clean.high = whole.high;  // so that paths are followed as far as any defect lies
    Truth truth;
    Labels labels(scene, clean);
    if (!clean.empty) labels.survey(scene.camera.extents.m < 200 ? 4 : 2);
    else truth.labels.assign(scene.camera.extents.lenslets(), 0);
    for (const SceneDefect& defect : scene.defects) {
        TruthDefect found = std::visit([&](const auto& d) { return labels.look_at(posed(d, scene.pose)); }, defect);
        found.kind = name_of(defect).data();
        if (found.area_lenslets > 0) truth.defects.push_back(found);
    }
    truth.defect_free = truth.defects.empty();
    if (clean.empty && !truth.defect_free) labels.survey(2);
    if (!clean.empty || !truth.defect_free) truth.labels = labels.labels(scene.camera.extents.m < 200 ? 1 : 2);
    return truth;
}

}  // namespace hord::lab
