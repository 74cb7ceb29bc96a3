// Solids of scenes that describe their own shapes (Shape, scene.h).
#pragma once

#include "hal_sim/optics/scene/solid.h"

namespace hord::sim {

[[nodiscard]] bool is_operation(Shape::Kind kind);  // union, intersection, difference
[[nodiscard]] int surfaces_of(const Shape& shape);  // its number of surfaces

// Infinite where the shape has no bound, as a half-space.
struct Bounds {
    Vec3 low{-kNever, -kNever, -kNever}, high{kNever, kNever, kNever};
};
[[nodiscard]] Bounds bounds_of(const Shape& shape);

// Adds the part to an empty body: surfaces, filling, box. The shape has no problems.
void build(Body& body, const SolidPart& part);

}  // namespace hord::sim
