// Follows one ray of the camera backwards through the part to the source.
#pragma once

#include <cstdint>
#include <span>

#include "algo/simd/isa.h"
#include "hal_sim/optics/scene/solid.h"

namespace hord::sim {

// A ray of the light field in the part's frame: through (x, y) of the measurement plane z = 0 with slope (u, v) =
// (dx/dz, dy/dz), as seen from the camera, in free space behind the part.
struct CameraRay {
    double x = 0, y = 0, u = 0, v = 0;
};

// What the light was before it met the part.
struct Arrival {
    double u = 0, v = 0;  // slope at the source
    double x = 0, y = 0;  // where its straight line meets the measurement plane
    double weight = 0;    // share of the light that survives; 0: lost
    std::uint64_t path =
        0;  // which surfaces it met, in order: rays of one path vary smoothly; 0: none reaches the source
};
constexpr std::uint64_t kFreePath = 1;                       // met nothing
constexpr std::uint64_t kMirrored = std::uint64_t{1} << 63;  // this bit of a path: it was reflected somewhere

// Where a ray goes, for who needs the way itself: corners, and whether the stretch up to each ran inside the part.
struct Way {
    static constexpr int kMaxPoints = 24;
    Vec3 points[kMaxPoints];
    bool in_part[kMaxPoints] = {};
    int count = 0;
};

// Light that is split at a face goes on both ways. `Ghost` follows the reflected share at two faces (counted from 0
// along the ray), where both reflect partially; without it the refracted share is followed.
struct Ghost {
    int first = -1, second = -1;
    [[nodiscard]] bool is_one() const { return first >= 0; }
};

// A ray that is reflected totally goes on, up to 16 crossings; then, or when it turns back, it is lost.
Arrival trace(const Body& body, const CameraRay& ray, Way* way = nullptr, Ghost ghost = {});

// arrivals[k] = trace(body, rays[k], nullptr, ghost), to the bit, and several times faster: rays of one way are traced
// side by side.
void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost = {});
void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost, algo::Isa isa);

// The same with the light: from the source, with slope 0, towards (x, y) of the measurement plane; where on that plane
// the camera sees it come from, and with which slope. `path` as in Arrival, but not comparable to trace()'s.
struct Landing {
    double x = 0, y = 0, u = 0, v = 0;
    double weight = 0;
    std::uint64_t path = 0;  // 0: the camera never sees it
};
Landing shine(const Body& body, double x, double y, Way* way = nullptr);

}  // namespace hord::sim
