// Vectors with one ray per lane. A VecPair is two machine vectors, so that the square root of one overlaps with work on
// the other. Operators as for double; comparisons give masks for select(). Words as in algo/simd/vec.h, whose Vec has
// no operators with a double and no masks as bits. Include in kernels' .cpp files only.
#pragma once

#include <cstdint>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "algo/simd/multiversion.h"
#include "hal_sim/optics/scene/geometry.h"

namespace hord::sim::ray_vec {

template <class V>
struct VecPair {
    V a, b;
};
template <int Bytes>
using Doubles = VecPair<algo::Vector<double, Bytes>>;
template <int Bytes>
using Paths = VecPair<algo::Vector<std::uint64_t, Bytes>>;
template <int Bytes>
using Mask = VecPair<algo::Vector<std::int64_t, Bytes>>;  // per lane all bits or none
template <class D>
constexpr unsigned kLaneCount = sizeof(D) / sizeof(double);

template <class V>
HORD_ALWAYS_INLINE VecPair<V> operator-(const VecPair<V>& x) {
    return {-x.a, -x.b};
}
template <class V>
HORD_ALWAYS_INLINE VecPair<V> operator~(const VecPair<V>& x) {
    return {~x.a, ~x.b};
}
#define HORD_VEC_PAIR_OPERATOR(OP)                                                                    \
    template <class V>                                                                                \
    HORD_ALWAYS_INLINE auto operator OP(const VecPair<V>& x, const VecPair<V>& y) {                   \
        return VecPair<decltype(x.a OP y.a)>{algo::as_lanes(x.a OP y.a), algo::as_lanes(x.b OP y.b)}; \
    }                                                                                                 \
    template <class V>                                                                                \
    HORD_ALWAYS_INLINE auto operator OP(double x, const VecPair<V>& y) {                              \
        return VecPair<decltype(x OP y.a)>{algo::as_lanes(x OP y.a), algo::as_lanes(x OP y.b)};       \
    }                                                                                                 \
    template <class V>                                                                                \
    HORD_ALWAYS_INLINE auto operator OP(const VecPair<V>& x, double y) {                              \
        return VecPair<decltype(x.a OP y)>{algo::as_lanes(x.a OP y), algo::as_lanes(x.b OP y)};       \
    }
HORD_VEC_PAIR_OPERATOR(+)
HORD_VEC_PAIR_OPERATOR(-)
HORD_VEC_PAIR_OPERATOR(*)
HORD_VEC_PAIR_OPERATOR(/)
HORD_VEC_PAIR_OPERATOR(<)
HORD_VEC_PAIR_OPERATOR(<=)
HORD_VEC_PAIR_OPERATOR(>)
HORD_VEC_PAIR_OPERATOR(>=)
HORD_VEC_PAIR_OPERATOR(==)
#undef HORD_VEC_PAIR_OPERATOR
template <class V>
HORD_ALWAYS_INLINE VecPair<V> operator&(const VecPair<V>& x, const VecPair<V>& y) {
    return {x.a & y.a, x.b & y.b};
}
template <class V>
HORD_ALWAYS_INLINE VecPair<V> operator|(const VecPair<V>& x, const VecPair<V>& y) {
    return {x.a | y.a, x.b | y.b};
}

template <class M, class V>
HORD_ALWAYS_INLINE VecPair<V> select(const VecPair<M>& mask, const VecPair<V>& yes, const VecPair<V>& no) {
    return {mask.a ? yes.a : no.a, mask.b ? yes.b : no.b};
}
template <class D>
HORD_ALWAYS_INLINE D broadcast(double x) {
    return {x - decltype(D::a){}, x - decltype(D::a){}};
}

template <class V>
HORD_ALWAYS_INLINE V sqrt_of(const V& x) {
    V out;
    for (unsigned k = 0; k < sizeof(V) / sizeof(double); ++k) out[k] = __builtin_sqrt(x[k]);
    return out;
}
template <class V>
HORD_ALWAYS_INLINE VecPair<V> sqrt(const VecPair<V>& x) {
    return {sqrt_of(x.a), sqrt_of(x.b)};
}
template <class D>
HORD_ALWAYS_INLINE D not_negative(const D& x) {
    return select(x < 0, D{}, x);
}  // std::max(x, 0.0)

// Bit k is the mask of lane k.
#if defined(__x86_64__)
inline unsigned mask_bits(const algo::Vector<std::int64_t, 16>& mask) {
    return static_cast<unsigned>(_mm_movemask_pd(reinterpret_cast<__m128d>(mask)));
}
[[gnu::target("avx2")]] inline unsigned mask_bits(const algo::Vector<std::int64_t, 32>& mask) {
    return static_cast<unsigned>(_mm256_movemask_pd(reinterpret_cast<__m256d>(mask)));
}
[[gnu::target("avx512f,avx512dq")]] inline unsigned mask_bits(const algo::Vector<std::int64_t, 64>& mask) {
    return _mm512_movepi64_mask(reinterpret_cast<__m512i>(mask));
}
#else
template <class V>
HORD_ALWAYS_INLINE unsigned mask_bits(const V& mask) {
    unsigned out = 0;
    for (unsigned k = 0; k < sizeof(V) / sizeof(std::int64_t); ++k) out |= static_cast<unsigned>(mask[k] & 1) << k;
    return out;
}
#endif
template <class V>
HORD_ALWAYS_INLINE unsigned mask_bits(const VecPair<V>& mask) {
    return mask_bits(mask.a) | mask_bits(mask.b) << (kLaneCount<VecPair<V>> / 2);
}

// One Vec3 per lane; the operators of geometry.h.
template <class D>
struct Vec3Lanes {
    D x, y, z;
    [[nodiscard]] Vec3 at(unsigned k) const {
        double out[3][kLaneCount<D>];
        algo::store(x, out[0]), algo::store(y, out[1]), algo::store(z, out[2]);
        return {out[0][k], out[1][k], out[2][k]};
    }
};
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator+(const Vec3Lanes<D>& a, const Vec3Lanes<D>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator-(const Vec3Lanes<D>& a, const Vec3Lanes<D>& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator-(const Vec3Lanes<D>& a, const Vec3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator+(const Vec3& a, const Vec3Lanes<D>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator*(const D& k, const Vec3Lanes<D>& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator*(const D& k, const Vec3& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> operator*(double k, const Vec3Lanes<D>& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE D dot(const Vec3Lanes<D>& a, const Vec3Lanes<D>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class D>
HORD_ALWAYS_INLINE D dot(const Vec3Lanes<D>& a, const Vec3& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class M, class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> select(const M& mask, const Vec3Lanes<D>& yes, const Vec3Lanes<D>& no) {
    return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}
template <class D>
HORD_ALWAYS_INLINE Vec3Lanes<D> unit(const Vec3Lanes<D>& a) {
    return (1 / sqrt(dot(a, a))) * a;
}

template <class D>
struct RayLanes {
    Vec3Lanes<D> origin, direction;
};

// The same operations in the same order as the scalar functions of these names in geometry.h.
template <class D>
HORD_ALWAYS_INLINE D convex_crossing(const D& b, const D& c, const D& gap, bool inside) {  // a = 1
    if (!inside) {
        const auto misses = (gap <= 0) | (b <= 0);
        if (mask_bits(~misses) == 0) return broadcast<D>(kNever);
        return select(misses, broadcast<D>(kNever), not_negative(c / (b + sqrt(gap))));
    }
    const D distance = sqrt(gap);
    D out = b + distance;
    if (const auto behind = b < 0; mask_bits(behind) != 0) out = select(behind, c / (b - distance), out);
    return not_negative(select(gap <= 0, b, out));
}
template <class D>
HORD_ALWAYS_INLINE D convex_crossing(const D& a, const D& b, const D& c, const D& gap, bool inside) {
    if (!inside) {
        const auto misses = (gap <= 0) | (b <= 0);
        if (mask_bits(~misses) == 0) return broadcast<D>(kNever);
        return select(misses, broadcast<D>(kNever), not_negative(c / (b + sqrt(a * gap))));
    }
    const D distance = sqrt(a * gap);
    D out = (b + distance) / a;
    if (const auto behind = b < 0; mask_bits(behind) != 0) out = select(behind, c / (b - distance), out);
    return not_negative(select(gap <= 0, b / a, out));
}

template <class D>
HORD_ALWAYS_INLINE D next_crossing(const Surface& surface, const RayLanes<D>& ray, bool inside, bool on_surface) {
    if (on_surface && !inside && surface.shape != Surface::Shape::asphere) return broadcast<D>(kNever);
    const Vec3Lanes<D> f = ray.origin - surface.point;
    const Vec3Lanes<D>& d = ray.direction;
    const double r = surface.radius;
    switch (surface.shape) {
        case Surface::Shape::plane: {
            if (on_surface) return broadcast<D>(kNever);
            const D towards = dot(d, surface.axis);
            return select(inside ? towards <= 0 : towards >= 0, broadcast<D>(kNever),
                          not_negative(-dot(f, surface.axis) / towards));
        }
        case Surface::Shape::sphere: {
            const D b = -dot(f, d);
            if (on_surface) return not_negative(2 * b);
            const Vec3Lanes<D> closest = f + b * d;
            return convex_crossing(b, dot(f, f) - r * r, r * r - dot(closest, closest), inside);
        }
        case Surface::Shape::cylinder: {
            const Vec3Lanes<D> e = d - dot(d, surface.axis) * surface.axis;
            const D a = dot(e, e);
            const auto along = a < kAlongAxis;
            if (mask_bits(~along) == 0) return broadcast<D>(kNever);
            const Vec3Lanes<D> g = f - dot(f, surface.axis) * surface.axis;
            const D b = -dot(g, e);
            if (on_surface) return select(along, broadcast<D>(kNever), not_negative(2 * b / a));
            const Vec3Lanes<D> closest = g + (b / a) * e;
            return select(along, broadcast<D>(kNever),
                          convex_crossing(a, b, dot(g, g) - r * r, r * r - dot(closest, closest), inside));
        }
        default: break;
    }
    double out[kLaneCount<D>];
    for (unsigned k = 0; k < kLaneCount<D>; ++k)
        out[k] = next_crossing_of_others(surface, {ray.origin.at(k), d.at(k)}, inside, on_surface);
    return algo::load<D>(out);
}

template <class D>
HORD_ALWAYS_INLINE unsigned inside_of(const Surface& surface, const Vec3Lanes<D>& p) {  // bit k: is_inside() of lane k
    const Vec3Lanes<D> f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane: return mask_bits(dot(f, surface.axis) < 0);
        case Surface::Shape::sphere: return mask_bits(dot(f, f) < surface.radius * surface.radius);
        case Surface::Shape::cylinder: {
            const Vec3Lanes<D> g = f - dot(f, surface.axis) * surface.axis;
            return mask_bits(dot(g, g) < surface.radius * surface.radius);
        }
        default: break;
    }
    unsigned out = 0;
    for (unsigned k = 0; k < kLaneCount<D>; ++k) out |= unsigned{is_inside(surface, p.at(k))} << k;
    return out;
}

// Bit k: lane k is inside and stays so up to distance `t`, by more than any rounding error.
template <class D>
HORD_ALWAYS_INLINE unsigned stays_inside(const Surface& surface, const RayLanes<D>& ray, const D& t) {
    constexpr double kClearly = 1 - 1e-6;
    const Vec3Lanes<D> f = (ray.origin - surface.point) + t * ray.direction;
    switch (surface.shape) {
        case Surface::Shape::sphere: return mask_bits(dot(f, f) < kClearly * surface.radius * surface.radius);
        case Surface::Shape::cylinder: {
            const Vec3Lanes<D> g = f - dot(f, surface.axis) * surface.axis;
            return mask_bits(dot(g, g) < kClearly * surface.radius * surface.radius);
        }
        default: return 0;
    }
}

template <class D>
struct FootLanes {
    Vec3Lanes<D> point, normal;
};
template <class D>
HORD_ALWAYS_INLINE FootLanes<D> foot_of(const Surface& surface, const Vec3Lanes<D>& p) {
    const Vec3Lanes<D> f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane:
            return {p - dot(f, surface.axis) * surface.axis,
                    {broadcast<D>(surface.axis.x), broadcast<D>(surface.axis.y), broadcast<D>(surface.axis.z)}};
        case Surface::Shape::sphere: {
            const Vec3Lanes<D> normal = unit(f);
            return {surface.point + surface.radius * normal, normal};
        }
        case Surface::Shape::cylinder: {
            const Vec3Lanes<D> along = dot(f, surface.axis) * surface.axis;
            const Vec3Lanes<D> normal = unit(f - along);
            return {(surface.point + along) + surface.radius * normal, normal};
        }
        default: break;
    }
    double out[6][kLaneCount<D>];
    for (unsigned k = 0; k < kLaneCount<D>; ++k) {
        const auto [point, normal] = sim::foot_of(surface, p.at(k));
        out[0][k] = point.x, out[1][k] = point.y, out[2][k] = point.z;
        out[3][k] = normal.x, out[4][k] = normal.y, out[5][k] = normal.z;
    }
    return {{algo::load<D>(out[0]), algo::load<D>(out[1]), algo::load<D>(out[2])},
            {algo::load<D>(out[3]), algo::load<D>(out[4]), algo::load<D>(out[5])}};
}

}  // namespace hord::sim::ray_vec
