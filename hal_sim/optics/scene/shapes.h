// The solids that a scene builds from shapes of its own (Shape, scene.h).
#pragma once

#include "hal_sim/optics/scene/solid.h"

namespace hord::sim {

[[nodiscard]] bool is_operation(Shape::Kind kind);  // union, intersection, difference: of others
[[nodiscard]] int surfaces_of(const Shape& shape);  // how many of a body's it takes

// Infinite where nothing bounds the shape: a half-space or an asphere that nothing closes.
struct Bounds {
    Vec3 low{-kNever, -kNever, -kNever}, high{kNever, kNever, kNever};
};
[[nodiscard]] Bounds bounds_of(const Shape& shape);

// Adds the part to an empty body: surfaces, filling, box. The shape has no problems.
void build(Body& body, const SolidPart& part);

}  // namespace hord::sim
