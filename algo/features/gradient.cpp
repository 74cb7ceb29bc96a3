#include "algo/features/gradient.h"

#include <cmath>

namespace hord::algo {

double EmdGradient::norm() const {
    const double across = weight_x * x, down = weight_y * y;
    return std::sqrt(across * across + down * down);
}

void submit_emd_gradient(EmdSolver& solver, const Stencil& across, const SparseHord& left, const SparseHord& right,
                         const Stencil& down, const SparseHord& above, const SparseHord& below, EmdGradient& out) {
    out = {0, 0, across.weight(), down.weight()};
    solver.submit(left, right, &out.x);
    solver.submit(above, below, &out.y);
}

}  // namespace hord::algo
