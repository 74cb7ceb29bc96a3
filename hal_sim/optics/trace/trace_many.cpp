// Traces one ray per lane, as long as all meet the same surfaces in the same order. A lane that departs from the first
// one is followed alone from there on. Every lane performs the operations of trace() in the same order, so its bits
// do not depend on the number of lanes or on the other rays.
#include <bit>

#include "hal_sim/optics/scene/exact_math.h"
#include "hal_sim/optics/trace/ray_state.h"
#include "hal_sim/optics/trace/ray_vec.h"

namespace hord::sim {
namespace {

using namespace ray_vec;

template <class D>
HORD_ALWAYS_INLINE void slab(const D& o, const D& d, double low, double high, D& in, D& out) {
    const D per = 1 / d, a = (low - o) * per, b = (high - o) * per;
    const D near = select(b < a, b, a), far = select(a < b, b, a);
    const D later = select(in < near, near, in), sooner = select(far < out, far, out);
    const auto still = d == 0;
    const bool any = mask_bits(still) != 0;
    in = any ? select(still, in, later) : later;
    out = any ? select(still, select((o < low) | (o > high), broadcast<D>(-1), out), sooner) : sooner;
}
template <class D>
HORD_ALWAYS_INLINE D leaves_box(const Body& body, const RayLanes<D>& ray) {
    D in{}, out = broadcast<D>(kNever);
    slab(ray.origin.x, ray.direction.x, body.low.x, body.high.x, in, out);
    slab(ray.origin.y, ray.direction.y, body.low.y, body.high.y, in, out);
    slab(ray.origin.z, ray.direction.z, body.low.z, body.high.z, in, out);
    return select(out >= in, out, broadcast<D>(-1));
}

// The same for rays that start on the upper side of the box; most leave through the lower one.
template <class D>
HORD_ALWAYS_INLINE D leaves_box_from_above(const Body& body, const RayLanes<D>& ray) {
    const D t = (body.low.z - body.high.z) / ray.direction.z;
    const D x = ray.origin.x + t * ray.direction.x, y = ray.origin.y + t * ray.direction.y;
    const auto within = [](const D& a, const D& b, double low, double high) __attribute__((always_inline)) {
        return (a > low) & (a < high) & (b > low) & (b < high);
    };
    if (mask_bits(~(within(ray.origin.x, x, body.low.x, body.high.x) &
                    within(ray.origin.y, y, body.low.y, body.high.y))) == 0)
        return t;
    return leaves_box(body, ray);
}

template <class V>
HORD_ALWAYS_INLINE VecPair<V> extend_path(const VecPair<V>& path, std::uint64_t step) {
    return {sim::extend_path(path.a, step), sim::extend_path(path.b, step)};
}

template <class D, class P>
HORD_ALWAYS_INLINE void pass_discs(const Body& body, const RayLanes<D>& ray, const D& to, D& weight, P& path) {
    for (std::size_t k = 0; k < body.discs.size(); ++k) {
        const Disc& disc = body.discs[k];
        const D t = (disc.centre.z - ray.origin.z) / ray.direction.z;
        const D x = ray.origin.x + t * ray.direction.x - disc.centre.x,
                y = ray.origin.y + t * ray.direction.y - disc.centre.y;
        const auto hit = (t >= 0) & (t < to) & (x * x + y * y < disc.radius * disc.radius);
        weight = select(hit, weight * disc.transmission, weight);
        path = select(hit, extend_path(path, disc_step(k)), path);
    }
}

template <class D>
struct Refracted {
    Vec3Lanes<D> direction;
    unsigned reflected;  // bit k: total reflection in lane k
    D passes;            // transmitted share
};

// refract() and fresnel_transmission() of refraction.h. `reflected` reports the lanes of `wanted` only.
template <bool kFresnel, class D>
HORD_ALWAYS_INLINE Refracted<D> refract(const Vec3Lanes<D>& direction, const Vec3Lanes<D>& normal, double before,
                                        double after, unsigned wanted) {
    D cosine = dot(direction, normal);
    const Vec3Lanes<D> tangent = direction - cosine * normal;
    const auto backwards = cosine < 0;
    const Vec3Lanes<D> onwards = select(backwards, -1.0 * normal, normal);
    cosine = select(backwards, -cosine, cosine);
    const double ratio = before / after;
    const D square = 1 - ratio * ratio * dot(tangent, tangent);
    const auto stays = square <= 0;
    const D cos_out = sqrt(square);
    const Vec3Lanes<D> bent = ratio * tangent + cos_out * onwards;
    Refracted<D> out{(1.5 - 0.5 * dot(bent, bent)) * bent, mask_bits(stays) & wanted, broadcast<D>(1)};
    if constexpr (kFresnel) {
        const D s = (before * cosine - after * cos_out) / (before * cosine + after * cos_out);
        const D p = (before * cos_out - after * cosine) / (before * cos_out + after * cosine);
        out.passes = select(stays, D{}, 1 - 0.5 * (s * s + p * p));
    }
    if (out.reflected != 0) out.direction = select(stays, unit(tangent - cosine * onwards), out.direction);
    return out;
}

template <class Do>
HORD_ALWAYS_INLINE void each(unsigned lanes, const Do& what) {
    for (; lanes != 0; lanes &= lanes - 1) what(static_cast<unsigned>(std::countr_zero(lanes)));
}

// Traces 2 to kLanes rays. One long function: the state of all lanes is shared by every step and kept in registers.
template <int Bytes, bool kLosses>
HORD_ALWAYS_INLINE void trace_packet(const Body& body, const CameraRay* from, unsigned count, Arrival* arrivals,
                                     [[maybe_unused]] Ghost ghost) {
    using D = Doubles<Bytes>;
    using P = Paths<Bytes>;
    constexpr unsigned kLanes = kLaneCount<D>;
    double given[4][kLanes];
    for (unsigned k = 0; k < kLanes; ++k) {
        const CameraRay& one = from[k < count ? k : 0];
        given[0][k] = one.x, given[1][k] = one.y, given[2][k] = one.u, given[3][k] = one.v;
    }
    const D x = algo::load<D>(given[0]), y = algo::load<D>(given[1]), u = algo::load<D>(given[2]),
            v = algo::load<D>(given[3]);
    const double start = body.high.z;
    RayLanes<D> ray{{x + u * start, y + v * start, broadcast<D>(start)}, unit(Vec3Lanes<D>{-u, -v, broadcast<D>(-1)})};
    D weight = broadcast<D>(1), leaves = leaves_box_from_above(body, ray);
    P path{};
    path.a += kFreePath, path.b += kFreePath;
    unsigned lanes = (1U << count) - 1;  // bit k: lane k still follows the path of the lowest set lane, the leader
    std::uint64_t inside_bits = 0, on_bits = 0;
    [[maybe_unused]] int faces = 0;

    const auto lose = [&](unsigned of) __attribute__((always_inline)) {
        each(of, [&](unsigned k) { arrivals[k] = {}; });
    };
    const auto arrive = [&](unsigned of) __attribute__((always_inline)) {
        if (!body.discs.empty()) pass_discs(body, ray, broadcast<D>(kNever), weight, path);
        const Vec3Lanes<D>&o = ray.origin, &d = ray.direction;
        const D s = d.x / d.z, t = d.y / d.z;
        double out[5][kLanes];
        std::uint64_t paths[kLanes];
        algo::store(s, out[0]), algo::store(t, out[1]), algo::store(o.x - s * o.z, out[2]),
            algo::store(o.y - t * o.z, out[3]);
        algo::store(weight, out[4]), algo::store(path, paths);
        const unsigned back = mask_bits(d.z >= 0);
        each(of, [&](unsigned k) {
            if (((back >> k) & 1U) != 0) arrivals[k] = {};
            else if (paths[k] == kFreePath)
                arrivals[k] = {from[k].u, from[k].v, from[k].x, from[k].y, out[4][k], kFreePath};
            else arrivals[k] = {out[0][k], out[1][k], out[2][k], out[3][k], out[4][k], paths[k]};
        });
    };

    if (const unsigned past = mask_bits(leaves < 0) & lanes; past != 0) {
        each(past, [&](unsigned k) {
            arrivals[k] = kLosses && ghost.is_one() ? Arrival{}
                                                    : Arrival{from[k].u, from[k].v, from[k].x, from[k].y, 1, kFreePath};
        });
        lanes &= ~past;
        if (lanes == 0) return;
    }
    const std::size_t surfaces = body.surfaces.size();
    const int most = max_crossings(body);
    unsigned other = 0;
    for (std::size_t s = 0; s < surfaces; ++s) {
        const unsigned inside = inside_of(body.surfaces[s], ray.origin),
                       leads = (inside >> std::countr_zero(lanes)) & 1U;
        inside_bits |= std::uint64_t{leads} << s;
        other |= leads != 0 ? ~inside : inside;
    }
    each(other & lanes, [&](unsigned k) { arrivals[k] = trace(body, from[k], nullptr, ghost); });
    lanes &= ~other;
    std::uint8_t medium = body.medium(inside_bits);
    if (medium != 0) leaves = broadcast<D>(kNever);

    D next[Body::kMaxSurfaces];
    for (int step = 0;; ++step) {
        D t = broadcast<D>(kNever);
        for (std::size_t s = 0; s < surfaces; ++s) {
            const bool inside = ((inside_bits >> s) & 1U) != 0, on = ((on_bits >> s) & 1U) != 0;
            next[s] = broadcast<D>(kNever);  // stays so where another surface is certainly met first
            if (s > 0 && inside && !on &&
                (lanes & ~stays_inside(body.surfaces[s], ray, t + kCoincident * body.size)) == 0)
                continue;
            next[s] = next_crossing(body.surfaces[s], ray, inside, on);
            t = select(next[s] < t, next[s], t);
        }
        if (medium == 0) {
            if (const unsigned left = mask_bits(t > leaves) & lanes; left != 0) {
                if (kLosses && faces <= ghost.second) lose(left);
                else arrive(left);
                lanes &= ~left;
                if (lanes == 0) return;
            }
        }
        std::size_t first = 0;
        while (first + 1 < surfaces && ((mask_bits(next[first] == t) >> std::countr_zero(lanes)) & 1U) == 0) ++first;
        // Lanes with another first surface, or with two that may coincide, are followed alone from here.
        const D nearest = t + kCoincident * body.size;
        auto clear = (next[first] == t) & (t < kNever);
        for (std::size_t s = 0; s < surfaces; ++s) {
            if (s != first) clear = clear & (next[s] > nearest);
        }
        unsigned same = step == most ? 0 : mask_bits(clear) & lanes;

        const std::uint64_t crossed = std::uint64_t{1} << first;
        const std::uint8_t beyond = body.medium(inside_bits ^ crossed);
        const double index_before = body.index(medium), index_after = body.index(beyond);
        const bool bends = index_before != index_after;
        const FootLanes<D> foot = foot_of(body.surfaces[first], ray.origin + t * ray.direction);
        Vec3Lanes<D> direction = ray.direction;
        bool reflected = false;
        [[maybe_unused]] D passes = broadcast<D>(1);
        if (bends && same != 0) {
            const Refracted<D> bent = refract<kLosses>(ray.direction, foot.normal, index_before, index_after, same);
            reflected = ((bent.reflected >> std::countr_zero(same)) & 1U) != 0;
            same &= reflected ? bent.reflected : ~bent.reflected;
            direction = bent.direction;
            if (kLosses && body.fresnel) passes = bent.passes;
        }
        if (const unsigned alone = lanes & ~same; alone != 0) {
            double weights[kLanes], leave[kLanes];
            std::uint64_t paths[kLanes];
            algo::store(weight, weights), algo::store(leaves, leave), algo::store(path, paths);
            each(alone, [&](unsigned k) {
                RayState state{{ray.origin.at(k), ray.direction.at(k)},
                               weights[k],
                               paths[k],
                               inside_bits,
                               on_bits,
                               medium,
                               leave[k],
                               step,
                               faces};
                arrivals[k] = continue_trace(body, state, nullptr, ghost) ? arrival_of(state, from[k]) : Arrival{};
            });
            lanes = same;
            if (lanes == 0) return;
        }

        if (!body.discs.empty()) pass_discs(body, ray, t, weight, path);
        if constexpr (kLosses) {
            if (const double absorption = body.absorption(medium); body.absorbs && absorption > 0) {
                double passed[kLanes];
                algo::store(t, passed);
                for (double& length : passed) length = exact::exp(-absorption * length);
                weight = weight * algo::load<D>(passed);
            }
            const unsigned dark = mask_bits(weight < kMinWeight) & lanes;
            lose(dark);
            lanes &= ~dark;
            if (lanes == 0) return;
        }
        if (bends) {
            if constexpr (kLosses) {
                const int face = faces++;
                if (face == ghost.first || face == ghost.second) {
                    if (reflected) return lose(lanes);
                    weight = weight * (1 - passes);
                    direction = unit(ray.direction - (2 * dot(ray.direction, foot.normal)) * foot.normal);
                    reflected = true;
                } else if (!reflected) {
                    weight = weight * passes;
                }
            }
            path = extend_path(path, surface_step(first, reflected));
        }
        ray = {foot.point, direction};
        on_bits = crossed;
        if (!reflected) {
            inside_bits ^= crossed;
            const bool out = medium != 0 && beyond == 0;
            medium = beyond;
            if (out && body.convex) {
                if (kLosses && faces <= ghost.second) return lose(lanes);
                return arrive(lanes);
            }
        }
        if (medium == 0) leaves = leaves_box(body, ray);
        else leaves = broadcast<D>(kNever);
    }
}

template <int Bytes>
HORD_ALWAYS_INLINE void trace_all(const Body& body, const CameraRay* rays, std::size_t count, Arrival* arrivals,
                                  Ghost ghost) {
    constexpr std::size_t kLanes = kLaneCount<Doubles<Bytes>>;
    for (std::size_t k = 0; k < count; k += kLanes) {
        const std::size_t some = count - k < kLanes ? count - k : kLanes;
        if (some == 1) arrivals[k] = trace(body, rays[k], nullptr, ghost);
        else if (body.has_losses())
            trace_packet<Bytes, true>(body, rays + k, static_cast<unsigned>(some), arrivals + k, ghost);
        else trace_packet<Bytes, false>(body, rays + k, static_cast<unsigned>(some), arrivals + k, ghost);
    }
}

HORD_FOR_EACH_ISA(traced, trace_all)

}  // namespace

void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost, algo::Isa isa) {
    traced(isa)(body, rays.data(), rays.size(), arrivals, ghost);
}

void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost) {
    static const algo::Isa isa = algo::best_isa();
    trace_many(body, rays, arrivals, ghost, isa);
}

}  // namespace hord::sim
