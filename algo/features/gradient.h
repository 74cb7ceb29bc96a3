// The EMD gradient (Eqs. 9-11): how much neighbouring HORDs differ.
//
//     x = EMD(left, right)      y = EMD(above, below)      norm = sqrt(x^2 + y^2)
//
// Unit: bin pitches over the two lenslets from neighbour to neighbour (not divided by two). EMD is exact, with
// Euclidean ground distance. Borders, dark and saturated lenslets: algo/features/stencil.h. Why the norm is Euclidean:
// docs/notes/features.md.
#pragma once

#include "algo/emd/emd_solver.h"
#include "algo/features/stencil.h"
#include "algo/frame/hord.h"

namespace hord::algo {

struct EmdGradient {
    double x = 0;  // EMD of the pair of the stencil, across and down
    double y = 0;
    int weight_x = 0;
    int weight_y = 0;
    [[nodiscard]] double norm() const;  // of the weighted components
};

// Submits the two pairs of the stencils; no HORD is dark. `out` is complete after solver.finish() and must stay in
// place until then; the HORDs need not.
void submit_emd_gradient(EmdSolver& solver, const Stencil& across, const SparseHord& left, const SparseHord& right,
                         const Stencil& down, const SparseHord& above, const SparseHord& below, EmdGradient& out);

}  // namespace hord::algo
