// Solids built from surfaces by union, intersection and difference, filled with media.
#pragma once

#include <cstdint>
#include <vector>

#include "hal_sim/optics/scene/geometry.h"

namespace hord::sim {

// A solid as a formula over surfaces' insides.
class Solid {
  public:
    static Solid inside(int surface) { return Solid(Op::surface, surface, {}); }
    static Solid all(std::vector<Solid> of) { return Solid(Op::all, 0, std::move(of)); }
    static Solid any(std::vector<Solid> of) { return Solid(Op::any, 0, std::move(of)); }
    static Solid difference(Solid from, Solid cut) {
        return Solid(Op::difference, 0, {std::move(from), std::move(cut)});
    }

    // Bit s of `state`: inside surface s.
    [[nodiscard]] bool contains(std::uint64_t state) const;

  private:
    enum class Op : std::uint8_t { surface, all, any, difference };
    Solid(Op op, int surface, std::vector<Solid> of) : op_(op), surface_(surface), of_(std::move(of)) {}
    Op op_;
    int surface_;
    std::vector<Solid> of_;
};

// A thin partly transparent disc, normal to the light.
struct Disc {
    Vec3 centre;
    double radius = 0;
    double transmission = 0;
    double scatter_rad = 0;  // the camera spreads what passes (lenslet_light.h); a traced ray goes straight on
};

// A small structure that may deflect light: rendering samples densely near it.
struct Feature {
    Vec3 from, to;          // a segment; a point where they are equal
    double reach = 0;       // all of it lies within this distance of the segment
    double resolution = 0;  // cells larger than this may overlook it
};

// The part with its defects, in the part's own frame.
struct Body {
    static constexpr int kMaxSurfaces = 64;

    std::vector<Surface> surfaces;
    std::vector<Disc> discs;
    std::vector<Feature> features;
    Vec3 low, high;   // everything lies in this box
    double size = 0;  // its diagonal, or the largest radius where that is larger
    bool empty = true;
    bool convex = false;  // the part without its defects: a ray leaves it only once

    // Waviness: what passes is deflected by `u`, `v` times the cosine of kx x + ky y + phase.
    struct Wave {
        double u = 0, v = 0;
        double kx = 0, ky = 0;  // per mm
        double phase = 0;
    };
    Wave wave;

    bool fresnel = false;  // reflection losses
    bool absorbs = false;  // absorption in some medium
    [[nodiscard]] bool has_losses() const { return fresnel || absorbs; }

    // Adds a surface and gives its number; -1 when there are kMaxSurfaces already.
    int add(const Surface& surface);
    // Sets the media: air outside `part`; inside, the last filling that contains the place, else the part's glass.
    void fill(Solid part, double index);
    void tint(double absorption);  // the part
    void fill_more(Solid defect, double index, double absorption = 0);
    void move(const Rigid& by);  // all of it; discs stay across the light
    void done();                 // call last

    // 0: outside the part; 1: the part; from 2 on, its defects, hollow ones, too.
    [[nodiscard]] std::uint8_t medium(std::uint64_t state) const {
        return table_.empty() ? work_out(state) : table_[static_cast<std::size_t>(state)];
    }
    [[nodiscard]] double index(std::uint8_t medium) const { return indices_[medium]; }
    [[nodiscard]] double part_index() const { return empty ? 1 : indices_[1]; }
    [[nodiscard]] double absorption(std::uint8_t medium) const { return absorptions_[medium]; }  // natural, per mm

  private:
    [[nodiscard]] std::uint8_t work_out(std::uint64_t state) const;
    std::vector<Solid> solids_;         // the part, then its defects
    std::vector<double> indices_{1.0};  // of air, the part, its defects
    std::vector<double> absorptions_{0.0};
    std::vector<std::uint8_t> table_;  // by state, for few surfaces
};

// The scene's part, with or without its defects, at a wavelength. The scene has no problems (scene.h).
Body body_of(const Scene& scene, bool with_defects, double wavelength_nm = kLineD);

// Index at a wavelength (nm) of a glass with this index at kLineD. Cauchy's two terms; exact at the lines d, F, C.
double dispersed(double index_d, double abbe_number, double wavelength_nm);

}  // namespace hord::sim
