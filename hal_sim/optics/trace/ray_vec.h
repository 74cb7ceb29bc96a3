// Numbers side by side, a ray each: two vectors of the machine's, so that one may wait for its square root while the
// other goes on. Operators as of double; comparisons give masks, pick() chooses by them. For kernels' .cpp files only.
#pragma once

#include <cstdint>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "algo/simd/multiversion.h"
#include "hal_sim/optics/scene/geometry.h"

namespace hord::sim::lanes {

template <class V>
struct Two {
    V a, b;
};
template <int Bytes>
using Doubles = Two<algo::Vector<double, Bytes>>;
template <int Bytes>
using Paths = Two<algo::Vector<std::uint64_t, Bytes>>;
template <int Bytes>
using Mask = Two<algo::Vector<std::int64_t, Bytes>>;  // all bits or none
template <class D>
constexpr unsigned kCount = sizeof(D) / sizeof(double);

template <class V>
HORD_ALWAYS_INLINE Two<V> operator-(const Two<V>& x) {
    return {-x.a, -x.b};
}
template <class V>
HORD_ALWAYS_INLINE Two<V> operator~(const Two<V>& x) {
    return {~x.a, ~x.b};
}
#define HORD_LANES_OPERATOR(OP)                                             \
    template <class V>                                                      \
    HORD_ALWAYS_INLINE auto operator OP(const Two<V>& x, const Two<V>& y) { \
        return Two<decltype(x.a OP y.a)>{x.a OP y.a, x.b OP y.b};           \
    }                                                                       \
    template <class V>                                                      \
    HORD_ALWAYS_INLINE auto operator OP(double x, const Two<V>& y) {        \
        return Two<decltype(x OP y.a)>{x OP y.a, x OP y.b};                 \
    }                                                                       \
    template <class V>                                                      \
    HORD_ALWAYS_INLINE auto operator OP(const Two<V>& x, double y) {        \
        return Two<decltype(x.a OP y)>{x.a OP y, x.b OP y};                 \
    }
HORD_LANES_OPERATOR(+)
HORD_LANES_OPERATOR(-)
HORD_LANES_OPERATOR(*)
HORD_LANES_OPERATOR(/)
HORD_LANES_OPERATOR(<)
HORD_LANES_OPERATOR(<=)
HORD_LANES_OPERATOR(>)
HORD_LANES_OPERATOR(>=)
HORD_LANES_OPERATOR(==)
#undef HORD_LANES_OPERATOR
template <class V>
HORD_ALWAYS_INLINE Two<V> operator&(const Two<V>& x, const Two<V>& y) {
    return {x.a & y.a, x.b & y.b};
}
template <class V>
HORD_ALWAYS_INLINE Two<V> operator|(const Two<V>& x, const Two<V>& y) {
    return {x.a | y.a, x.b | y.b};
}

template <class M, class V>
HORD_ALWAYS_INLINE Two<V> pick(const Two<M>& mask, const Two<V>& yes, const Two<V>& no) {
    return {mask.a ? yes.a : no.a, mask.b ? yes.b : no.b};
}
template <class D>
HORD_ALWAYS_INLINE D all(double x) {
    return {x - decltype(D::a){}, x - decltype(D::a){}};
}

template <class V>
HORD_ALWAYS_INLINE V root_of(const V& x) {
    V out;
    for (unsigned k = 0; k < sizeof(V) / sizeof(double); ++k) out[k] = __builtin_sqrt(x[k]);
    return out;
}
template <class V>
HORD_ALWAYS_INLINE Two<V> root(const Two<V>& x) {
    return {root_of(x.a), root_of(x.b)};
}
template <class D>
HORD_ALWAYS_INLINE D not_negative(const D& x) {
    return pick(x < 0, D{}, x);
}  // std::max(x, 0.0)

// Bit k: lane k's.
#if defined(__x86_64__)
inline unsigned bits_of(const algo::Vector<std::int64_t, 16>& mask) {
    return static_cast<unsigned>(_mm_movemask_pd(reinterpret_cast<__m128d>(mask)));
}
[[gnu::target("avx2")]] inline unsigned bits_of(const algo::Vector<std::int64_t, 32>& mask) {
    return static_cast<unsigned>(_mm256_movemask_pd(reinterpret_cast<__m256d>(mask)));
}
[[gnu::target("avx512f,avx512dq")]] inline unsigned bits_of(const algo::Vector<std::int64_t, 64>& mask) {
    return _mm512_movepi64_mask(reinterpret_cast<__m512i>(mask));
}
#else
template <class V>
HORD_ALWAYS_INLINE unsigned bits_of(const V& mask) {
    unsigned out = 0;
    for (unsigned k = 0; k < sizeof(V) / sizeof(std::int64_t); ++k) out |= static_cast<unsigned>(mask[k] & 1) << k;
    return out;
}
#endif
template <class V>
HORD_ALWAYS_INLINE unsigned bits(const Two<V>& mask) {
    return bits_of(mask.a) | bits_of(mask.b) << (kCount<Two<V>> / 2);
}

// Vec3's, a lane each; the operators of geometry.h.
template <class D>
struct Vec3s {
    D x, y, z;
    [[nodiscard]] Vec3 at(unsigned k) const {
        double out[3][kCount<D>];
        algo::store(x, out[0]), algo::store(y, out[1]), algo::store(z, out[2]);
        return {out[0][k], out[1][k], out[2][k]};
    }
};
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator+(const Vec3s<D>& a, const Vec3s<D>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator-(const Vec3s<D>& a, const Vec3s<D>& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator-(const Vec3s<D>& a, const Vec3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator+(const Vec3& a, const Vec3s<D>& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator*(const D& k, const Vec3s<D>& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator*(const D& k, const Vec3& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> operator*(double k, const Vec3s<D>& a) {
    return {k * a.x, k * a.y, k * a.z};
}
template <class D>
HORD_ALWAYS_INLINE D dot(const Vec3s<D>& a, const Vec3s<D>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class D>
HORD_ALWAYS_INLINE D dot(const Vec3s<D>& a, const Vec3& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class M, class D>
HORD_ALWAYS_INLINE Vec3s<D> pick(const M& mask, const Vec3s<D>& yes, const Vec3s<D>& no) {
    return {pick(mask, yes.x, no.x), pick(mask, yes.y, no.y), pick(mask, yes.z, no.z)};
}
template <class D>
HORD_ALWAYS_INLINE Vec3s<D> unit(const Vec3s<D>& a) {
    return (1 / root(dot(a, a))) * a;
}

template <class D>
struct Rays {
    Vec3s<D> origin, direction;
};

// As the scalar functions of the same names in geometry.h, operation by operation.
template <class D>
HORD_ALWAYS_INLINE D convex_crossing(const D& b, const D& c, const D& gap, bool inside) {  // a = 1
    if (!inside) {
        const auto misses = (gap <= 0) | (b <= 0);
        if (bits(~misses) == 0) return all<D>(kNever);
        return pick(misses, all<D>(kNever), not_negative(c / (b + root(gap))));
    }
    const D distance = root(gap);
    D out = b + distance;
    if (const auto behind = b < 0; bits(behind) != 0) out = pick(behind, c / (b - distance), out);
    return not_negative(pick(gap <= 0, b, out));
}
template <class D>
HORD_ALWAYS_INLINE D convex_crossing(const D& a, const D& b, const D& c, const D& gap, bool inside) {
    if (!inside) {
        const auto misses = (gap <= 0) | (b <= 0);
        if (bits(~misses) == 0) return all<D>(kNever);
        return pick(misses, all<D>(kNever), not_negative(c / (b + root(a * gap))));
    }
    const D distance = root(a * gap);
    D out = (b + distance) / a;
    if (const auto behind = b < 0; bits(behind) != 0) out = pick(behind, c / (b - distance), out);
    return not_negative(pick(gap <= 0, b / a, out));
}

template <class D>
HORD_ALWAYS_INLINE D next_crossing(const Surface& surface, const Rays<D>& ray, bool inside, bool on_surface) {
    if (on_surface && !inside && surface.shape != Surface::Shape::asphere) return all<D>(kNever);
    const Vec3s<D> f = ray.origin - surface.point;
    const Vec3s<D>& d = ray.direction;
    const double r = surface.radius;
    switch (surface.shape) {
        case Surface::Shape::plane: {
            if (on_surface) return all<D>(kNever);
            const D towards = dot(d, surface.axis);
            return pick(inside ? towards <= 0 : towards >= 0, all<D>(kNever),
                        not_negative(-dot(f, surface.axis) / towards));
        }
        case Surface::Shape::sphere: {
            const D b = -dot(f, d);
            if (on_surface) return not_negative(2 * b);
            const Vec3s<D> closest = f + b * d;
            return convex_crossing(b, dot(f, f) - r * r, r * r - dot(closest, closest), inside);
        }
        case Surface::Shape::cylinder: {
            const Vec3s<D> e = d - dot(d, surface.axis) * surface.axis;
            const D a = dot(e, e);
            const auto along = a < kAlongAxis;
            if (bits(~along) == 0) return all<D>(kNever);
            const Vec3s<D> g = f - dot(f, surface.axis) * surface.axis;
            const D b = -dot(g, e);
            if (on_surface) return pick(along, all<D>(kNever), not_negative(2 * b / a));
            const Vec3s<D> closest = g + (b / a) * e;
            return pick(along, all<D>(kNever),
                        convex_crossing(a, b, dot(g, g) - r * r, r * r - dot(closest, closest), inside));
        }
        default: break;
    }
    double out[kCount<D>];
    for (unsigned k = 0; k < kCount<D>; ++k)
        out[k] = next_crossing_of_others(surface, {ray.origin.at(k), d.at(k)}, inside, on_surface);
    return algo::load<D>(out);
}

template <class D>
HORD_ALWAYS_INLINE unsigned inside_of(const Surface& surface, const Vec3s<D>& p) {  // bit k: is_inside() of lane k
    const Vec3s<D> f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane: return bits(dot(f, surface.axis) < 0);
        case Surface::Shape::sphere: return bits(dot(f, f) < surface.radius * surface.radius);
        case Surface::Shape::cylinder: {
            const Vec3s<D> g = f - dot(f, surface.axis) * surface.axis;
            return bits(dot(g, g) < surface.radius * surface.radius);
        }
        default: break;
    }
    unsigned out = 0;
    for (unsigned k = 0; k < kCount<D>; ++k) out |= unsigned{is_inside(surface, p.at(k))} << k;
    return out;
}

// Lanes that are inside and will be so up to `t` at least, for certain: by more than any rounding.
template <class D>
HORD_ALWAYS_INLINE unsigned stays_inside(const Surface& surface, const Rays<D>& ray, const D& t) {
    constexpr double kClearly = 1 - 1e-6;
    const Vec3s<D> f = (ray.origin - surface.point) + t * ray.direction;
    switch (surface.shape) {
        case Surface::Shape::sphere: return bits(dot(f, f) < kClearly * surface.radius * surface.radius);
        case Surface::Shape::cylinder: {
            const Vec3s<D> g = f - dot(f, surface.axis) * surface.axis;
            return bits(dot(g, g) < kClearly * surface.radius * surface.radius);
        }
        default: return 0;
    }
}

template <class D>
struct Feet {
    Vec3s<D> point, normal;
};
template <class D>
HORD_ALWAYS_INLINE Feet<D> foot_of(const Surface& surface, const Vec3s<D>& p) {
    const Vec3s<D> f = p - surface.point;
    switch (surface.shape) {
        case Surface::Shape::plane:
            return {p - dot(f, surface.axis) * surface.axis,
                    {all<D>(surface.axis.x), all<D>(surface.axis.y), all<D>(surface.axis.z)}};
        case Surface::Shape::sphere: {
            const Vec3s<D> normal = unit(f);
            return {surface.point + surface.radius * normal, normal};
        }
        case Surface::Shape::cylinder: {
            const Vec3s<D> along = dot(f, surface.axis) * surface.axis;
            const Vec3s<D> normal = unit(f - along);
            return {(surface.point + along) + surface.radius * normal, normal};
        }
        default: break;
    }
    double out[6][kCount<D>];
    for (unsigned k = 0; k < kCount<D>; ++k) {
        const auto [point, normal] = sim::foot_of(surface, p.at(k));
        out[0][k] = point.x, out[1][k] = point.y, out[2][k] = point.z;
        out[3][k] = normal.x, out[4][k] = normal.y, out[5][k] = normal.z;
    }
    return {{algo::load<D>(out[0]), algo::load<D>(out[1]), algo::load<D>(out[2])},
            {algo::load<D>(out[3]), algo::load<D>(out[4]), algo::load<D>(out[5])}};
}

}  // namespace hord::sim::lanes
