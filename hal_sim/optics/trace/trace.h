// Follows rays of the camera backwards through the part to the source.
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

// The light before it met the part.
struct Arrival {
    double u = 0, v = 0;     // slope at the source
    double x = 0, y = 0;     // where its straight line meets the measurement plane
    double weight = 0;       // share of the light that survives; 0: lost
    std::uint64_t path = 0;  // hash of the surfaces met, in order; results vary smoothly within a path; 0: lost
};
constexpr std::uint64_t kFreePath = 1;                       // met nothing
constexpr std::uint64_t kMirrored = std::uint64_t{1} << 63;  // bit of a path: it was reflected at least once

// The corners of a ray, and whether the segment up to each lies inside the part.
struct RayPolyline {
    static constexpr int kMaxPoints = 24;
    Vec3 points[kMaxPoints];
    bool in_part[kMaxPoints] = {};
    int count = 0;
};

// A face splits light into a refracted and a reflected share. By default the refracted one is followed. A Ghost follows
// the reflected share at two faces, counted from 0 along the ray, where both reflect partially.
struct Ghost {
    int first = -1, second = -1;
    [[nodiscard]] bool is_one() const { return first >= 0; }
};

// Total reflection is followed. A ray is lost after max_crossings() (ray_state.h), or when it turns back to the camera.
Arrival trace(const Body& body, const CameraRay& ray, RayPolyline* polyline = nullptr, Ghost ghost = {});

// arrivals[k] = trace(body, rays[k], nullptr, ghost), to the bit, several times faster: rays with the same path are
// traced as vectors.
void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost = {});
void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost, algo::Isa isa);

// Follows light forwards: from the source, with slope 0, towards (x, y) of the measurement plane. The result is the
// point of that plane and the slope at which the camera sees it. `path` is not comparable to that of trace().
struct Landing {
    double x = 0, y = 0, u = 0, v = 0;
    double weight = 0;
    std::uint64_t path = 0;  // 0: the camera never sees it
};
Landing shine(const Body& body, double x, double y, RayPolyline* polyline = nullptr);

}  // namespace hord::sim
