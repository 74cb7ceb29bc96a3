#include "algo/gradient.h"

#include <cmath>

namespace hord::algo {

double EmdGradient::norm() const { return std::sqrt(x * x + y * y); }

EmdGradient emd_gradient(EmdSolver& solver, const Stencil& across, const Hord& left, const Hord& right, const Stencil& down, const Hord& above,
                         const Hord& below) {
    return {across.weight() * solver.distance(left, right), down.weight() * solver.distance(above, below)};
}

}  // namespace hord::algo
