// The passes of a scene: its sources, wavelengths, places of the moving part, and ghosts.
#include <algorithm>
#include <cmath>

#include "hal_sim/optics/camera/lenslet_light.h"

namespace hord::sim {
namespace {

// The number of places of the moving part: at most a quarter of a lenslet apart.
int places_of(const Motion& motion, double pitch_mm) {
    const double way = std::hypot(motion.way_x_mm(), motion.way_y_mm());
    return way > 0 ? std::max(2, static_cast<int>(std::ceil(4 * way / pitch_mm))) : 1;
}

// A uniform spectrum by three-point Gauss-Legendre quadrature.
struct Line {
    double wavelength_nm, share;
};
std::vector<Line> spectrum_of(const Collimator& source) {
    if (!(source.bandwidth_nm > 0)) return {{source.wavelength_nm, 1}};
    const double off = 0.77459666924148338 * 0.5 * source.bandwidth_nm;
    return {{source.wavelength_nm - off, 5.0 / 18},
            {source.wavelength_nm, 8.0 / 18},
            {source.wavelength_nm + off, 5.0 / 18}};
}

}  // namespace

LensletLight::LensletLight(const Scene& scene, const SlopeGrid& grid)
    : camera_(scene), obstacles_(scene), bin_rad_(scene.camera.bin_pitch_rad) {
    const auto optics_at = [&](double wavelength_nm) {
        // Without dispersion and diffraction all wavelengths share one set.
        const bool same = !is_dispersive(scene) && !scene.effects.diffraction;
        for (const auto& known : optics_) {
            if (same || known->wavelength_nm == wavelength_nm) return known.get();
        }
        auto made = std::make_unique<Optics>(Optics{wavelength_nm, body_of(scene, true, wavelength_nm),
                                                    body_of(scene, false, wavelength_nm), nullptr, nullptr});
        made->clean.low = made->body.low;
        made->clean.high = made->body.high;
        if (scene.effects.diffraction) {
            const double first_zero = wavelength_nm * 1e-6 / camera_.pitch_mm() / bin_rad_;
            made->diffraction =
                std::make_unique<SlopeBlur>(SlopeBlur::diffraction(first_zero, grid.step, std::max(grid.i, grid.j)));
        }
        for (std::size_t k = 0; k < made->body.discs.size(); ++k) {
            const Disc& disc = made->body.discs[k];
            if (!(disc.scatter_rad > 0)) continue;
            made->scattering = std::make_unique<Scattering>(
                Scattering{SlopeBlur::gaussian(disc.scatter_rad / bin_rad_, grid.step, std::max(grid.i, grid.j)),
                           made->body,
                           {disc.centre, disc.centre, disc.radius, disc.radius / 2}});
            made->scattering->opaque.discs[k].transmission = 0;
        }
        optics_.push_back(std::move(made));
        return optics_.back().get();
    };
    std::vector<Ghost> ways{{}};
    constexpr int kFaces = 5;  // light reflected at later ones is not followed
    if (scene.effects.ghosts) {
        for (int first = 1; first < kFaces; ++first) {
            for (int second = first + 1; second <= kFaces; ++second) ways.push_back({first, second});
        }
    }
    const int places = places_of(scene.motion, camera_.pitch_mm());
    for (const Collimator& source : collimators_of(scene)) {
        for (const Line& line : spectrum_of(source)) {
            const Optics* const optics = optics_at(line.wavelength_nm);
            for (int k = 0; k < places; ++k) {
                const double moved = (k + 0.5) / places - 0.5;
                for (const Ghost& way : ways) {
                    passes_.push_back({optics, source.direction_x_rad / bin_rad_, source.direction_y_rad / bin_rad_,
                                       source.radius_rad / bin_rad_, source.power * line.share / places,
                                       moved * scene.motion.way_x_mm(), moved * scene.motion.way_y_mm(), way});
                }
            }
        }
    }
    std::stable_sort(passes_.begin(), passes_.end(),
                     [](const Pass& a, const Pass& b) { return a.optics->wavelength_nm < b.optics->wavelength_nm; });
}

}  // namespace hord::sim
