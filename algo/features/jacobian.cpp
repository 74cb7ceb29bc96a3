#include "algo/features/jacobian.h"

#include <algorithm>

namespace hord::algo {
namespace {

SlopeQ slope(const Stencil& s, DeflectionQ before, DeflectionQ after) {
    return DeflectionQ::from_raw(std::int64_t{(after - before).raw()} * s.weight()).halved();
}

std::uint64_t squared(std::int64_t raw) { return static_cast<std::uint64_t>(raw * raw); }

}  // namespace

Jacobian jacobian_of(const Stencil& across, const Deflection& left, const Deflection& right, const Stencil& down,
                     const Deflection& above, const Deflection& below) {
    return {slope(across, left.x, right.x), slope(down, above.x, below.x), slope(across, left.y, right.y),
            slope(down, above.y, below.y)};
}

SlopeQ frobenius_norm(const Jacobian& jacobian) {
    return SlopeQ::from_raw(
        frobenius_raw(jacobian.x_by_m.raw(), jacobian.x_by_n.raw(), jacobian.y_by_m.raw(), jacobian.y_by_n.raw()));
}

SingularNorms singular_norms(const Jacobian& jacobian) {
    const std::int64_t x_m = jacobian.x_by_m.raw(), x_n = jacobian.x_by_n.raw(), y_m = jacobian.y_by_m.raw(),
                       y_n = jacobian.y_by_n.raw();
    const auto p = static_cast<std::int64_t>(square_root_floored(squared(x_m + y_n) + squared(x_n - y_m)));
    const auto q = static_cast<std::int64_t>(square_root_floored(squared(x_m - y_n) + squared(x_n + y_m)));
    const std::int64_t large = std::max(p, q), small = std::min(p, q);
    return {SlopeQ::from_raw(large), Q<5, 26>::from_raw(p + q),
            large == 0 ? ShareQ{} : ShareQ::from_ratio_rounded(small, large)};
}

}  // namespace hord::algo
