#include "algo/frame/lenslet_grid.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace hord::algo {
namespace {

// In the order of GridModelKind.
struct ModelTraits {
    std::string_view name;
    int parameters;
};
constexpr std::array<ModelTraits, kGridModels.size()> kTraits{{{"similarity", 4},
                                                               {"similarity+k1", 5},
                                                               {"affine", 6},
                                                               {"homography", 8},
                                                               {"homography+k1", 9},
                                                               {"homography+division", 9},
                                                               {"homography+k1+k2+centre", 12},
                                                               {"homography+rational+centre", 12},
                                                               {"cubic", 20},
                                                               {"quintic", 42}}};
const ModelTraits& traits(GridModelKind model) { return kTraits[static_cast<std::size_t>(model)]; }

// Terms u^p v^q, p + q <= order, in the order 1, u, v, u2, uv, v2, ...; `coefficients` holds them in the same order.
template <int order>
double polynomial(const double* coefficients, double u, double v) {
    double of_u[order + 1], of_v[order + 1];  // powers
    of_u[0] = of_v[0] = 1;
#pragma GCC unroll 8
    for (int k = 1; k <= order; ++k) {
        of_u[k] = of_u[k - 1] * u;
        of_v[k] = of_v[k - 1] * v;
    }
    double sum = 0;
#pragma GCC unroll 8
    for (int degree = 0; degree <= order; ++degree) {
#pragma GCC unroll 8
        for (int q = 0; q <= degree; ++q) sum += *coefficients++ * of_u[degree - q] * of_v[q];
    }
    return sum;
}

}  // namespace

std::string_view name_of(GridModelKind model) { return traits(model).name; }
int parameter_count(GridModelKind model) { return traits(model).parameters; }

std::string_view name_of(LatticeKind kind) { return kind == LatticeKind::square ? "square" : "hexagonal"; }

std::string_view name_of(Stagger stagger) {
    if (stagger == Stagger::none) return "none";
    return stagger == Stagger::rows ? "rows" : "columns";
}

std::string parameter_name(GridModelKind model, int index) {
    if (model == GridModelKind::cubic || model == GridModelKind::quintic) {
        const int half = parameter_count(model) / 2;
        int term = index % half;
        int degree = 0;
        while (term > degree) term -= ++degree;
        return std::string(index < half ? "x" : "y") + "_u" + std::to_string(degree - term) + "v" +
            std::to_string(term);
    }
    if (model == GridModelKind::similarity_radial1 && index == 4) return "k1";
    static constexpr std::array<const char*, 12> kNames{"tx", "ty", "a",  "b",  "c",  "d",
                                                        "g",  "h",  "k1", "k2", "cx", "cy"};
    return kNames[static_cast<std::size_t>(std::clamp(index, 0, 11))];
}

LensletGrid::Uv LensletGrid::uv(int m, int n) const {
    double ideal_u = m;
    double ideal_v = n;
    if (stagger == Stagger::rows) {
        ideal_u += 0.5 * shifted(n, parity);
        ideal_v *= kHalfSqrt3;
    } else if (stagger == Stagger::columns) {
        ideal_u *= kHalfSqrt3;
        ideal_v += 0.5 * shifted(m, parity);
    }
    return {(ideal_u - origin_u) / span, (ideal_v - origin_v) / span};
}

RadialTerms radial_terms(GridModelKind model) {
    switch (model) {
        case GridModelKind::similarity_radial1: return {4, false};
        case GridModelKind::radial1:
        case GridModelKind::division1: return {8, false};
        case GridModelKind::radial2:
        case GridModelKind::rational2: return {8, true};
        default: return {};
    }
}

double radial_stretch(GridModelKind model, double k1, double k2, double r2) {
    if (model == GridModelKind::division1) {
        const double root = std::sqrt(std::max(0.0, 1 - 4 * k1 * r2));
        return (1 - root) / (1 + root);
    }
    if (model == GridModelKind::rational2) return (k1 - k2) * r2 / (1 + k2 * r2);
    return (k1 + k2 * r2) * r2;
}

PixelPoint LensletGrid::at(Uv where) const {
    const auto [u, v] = where;
    const double* p = parameters.data();
    PixelPoint point;
    switch (model) {
        case GridModelKind::similarity:
        case GridModelKind::similarity_radial1: point = {p[0] + p[2] * u - p[3] * v, p[1] + p[3] * u + p[2] * v}; break;
        case GridModelKind::affine: return {p[0] + p[2] * u + p[3] * v, p[1] + p[4] * u + p[5] * v};
        case GridModelKind::cubic: return {polynomial<3>(p, u, v), polynomial<3>(p + 10, u, v)};
        case GridModelKind::quintic: return {polynomial<5>(p, u, v), polynomial<5>(p + 21, u, v)};
        default: {
            const double w = 1.0 + p[6] * u + p[7] * v;
            point = {p[0] + (p[2] * u + p[3] * v) / w, p[1] + (p[4] * u + p[5] * v) / w};
        }
    }
    const RadialTerms radial = radial_terms(model);
    if (radial.first < 0) return point;
    const double* k = p + radial.first;
    const double dx = (point.x_px - middle_x_px) / radius_px - (radial.second ? k[2] : 0.0);
    const double dy = (point.y_px - middle_y_px) / radius_px - (radial.second ? k[3] : 0.0);
    const double r2 = dx * dx + dy * dy;
    const double stretch = radial_stretch(model, k[0], radial.second ? k[1] : 0.0, r2) * radius_px;
    return {point.x_px + dx * stretch, point.y_px + dy * stretch};
}

LensletGrid::Steps LensletGrid::steps_px(Uv where) const {
    const double half = 0.5 / span;
    const PixelPoint right = at({where.u + half, where.v});
    const PixelPoint left = at({where.u - half, where.v});
    const PixelPoint below = at({where.u, where.v + half});
    const PixelPoint above = at({where.u, where.v - half});
    return {{right.x_px - left.x_px, right.y_px - left.y_px}, {below.x_px - above.x_px, below.y_px - above.y_px}};
}

Result<void> check(const LensletGrid& grid) {
    const auto bad = [](std::string what) {
        return fail(ErrorCode::invalid_argument, std::move(what),
                    "calibrate again, or use an unchanged calibration file");
    };
    if (static_cast<int>(grid.parameters.size()) != parameter_count(grid.model)) {
        return bad("a " + std::string(name_of(grid.model)) + " grid with " + std::to_string(grid.parameters.size()) +
                   " parameters, not " + std::to_string(parameter_count(grid.model)));
    }
    for (const double p : grid.parameters) {
        if (!std::isfinite(p)) return bad("a grid parameter that is not a number");
    }
    if ((grid.kind == LatticeKind::square) != (grid.stagger == Stagger::none)) {
        return bad("a " + std::string(name_of(grid.kind)) + " grid with stagger " + std::string(name_of(grid.stagger)));
    }
    if (grid.columns < 1 || grid.rows < 1 || grid.columns > 4096 || grid.rows > 4096 || grid.width_px < 1 ||
        grid.height_px < 1) {
        return bad("a grid of " + std::to_string(grid.columns) + "x" + std::to_string(grid.rows) + " lenslets");
    }
    if (!grid.shifts_px.empty()) {
        if (grid.shifts_px.size() != static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows)) {
            return bad("shifts of " + std::to_string(grid.shifts_px.size()) + " lenslets in a grid of " +
                       std::to_string(grid.columns) + "x" + std::to_string(grid.rows));
        }
        for (const PixelPoint& shift : grid.shifts_px) {
            if (!std::isfinite(shift.x_px) || !std::isfinite(shift.y_px))
                return bad("a lenslet's shift that is not a number");
        }
    }
    if (!(grid.span > 0) || !(grid.radius_px > 0)) return bad("a grid whose scale is not positive");
    return {};
}

}  // namespace hord::algo
