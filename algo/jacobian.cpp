#include "algo/jacobian.h"

namespace hord::algo {
namespace {

SlopeQ slope(const Stencil& s, DeflectionQ before, DeflectionQ after) {
    return DeflectionQ::from_raw(std::int64_t{(after - before).raw()} * s.weight()).halved();
}

std::uint64_t squared(SlopeQ value) { return static_cast<std::uint64_t>(std::int64_t{value.raw()} * value.raw()); }

}  // namespace

Jacobian jacobian_of(const Stencil& across, const Deflection& left, const Deflection& right, const Stencil& down, const Deflection& above,
                     const Deflection& below) {
    return {slope(across, left.x, right.x), slope(down, above.x, below.x), slope(across, left.y, right.y), slope(down, above.y, below.y)};
}

SlopeQ frobenius_norm(const Jacobian& jacobian) {
    const std::uint64_t sum = squared(jacobian.x_by_m) + squared(jacobian.x_by_n) + squared(jacobian.y_by_m) + squared(jacobian.y_by_n);
    return SlopeQ::from_raw(static_cast<std::int64_t>(square_root_floored(sum)));
}

}  // namespace hord::algo
