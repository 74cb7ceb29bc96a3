// Traces one ray per lane, as long as all meet the same surfaces in the same order. A ray that departs from the first
// lane's waits until others are in its state, and goes on together with them. Every lane performs the operations of
// trace() in the same order, so its bits do not depend on the number of lanes or on the other rays.
#include <algorithm>
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

constexpr int kFewest = 3;  // rays of a packet that are sooner followed together than one by one

// Rays that may go on together: they have met the same surfaces in the same order.
struct PathState {
    std::uint64_t inside_bits = 0, on_bits = 0;
    int step = 0, faces = 0;
    bool operator==(const PathState&) const = default;
};

template <class D>
struct Packet {
    RayLanes<D> ray;
    D weight, leaves;
    VecPair<algo::Vector<std::uint64_t, sizeof(D) / 2>> path;
    unsigned lanes = 0;  // bit k: lane k still follows the path of the lowest set lane, the leader
    PathState at;
    std::uint32_t index[kLaneCount<D>];  // of the ray of each lane
    bool alone = false;                  // its few rays need not wait for others
};

// The lanes of vectors, one by one.
template <class D>
struct Lanes {
    double values[8][kLaneCount<D>];  // origin, direction, weight, leaves
    std::uint64_t path[kLaneCount<D>];

    template <class P>
    HORD_ALWAYS_INLINE Lanes(const RayLanes<D>& ray, const D& weight, const D& leaves, const P& paths) {
        algo::store(ray.origin.x, values[0]), algo::store(ray.origin.y, values[1]);
        algo::store(ray.origin.z, values[2]), algo::store(ray.direction.x, values[3]);
        algo::store(ray.direction.y, values[4]), algo::store(ray.direction.z, values[5]);
        algo::store(weight, values[6]), algo::store(leaves, values[7]), algo::store(paths, path);
    }
};

// Rays that have left their packets, by state.
template <class D>
class Departed {
  public:
    static constexpr unsigned kLanes = kLaneCount<D>;

    // False: there is no room.
    HORD_ALWAYS_INLINE bool add(const PathState& at, std::uint32_t index, const Lanes<D>& lanes, unsigned lane) {
        Group* to = nullptr;
        for (Group& group : groups_) {
            if (group.count != 0 && group.at == at) {
                to = &group;
                break;
            }
            if (group.count == 0) to = &group;
        }
        if (to == nullptr || to->count == kRoom) return false;
        to->at = at;
        const unsigned k = to->count++;
        to->index[k] = index;
        to->path[k] = lanes.path[lane];
        for (int v = 0; v < 8; ++v) to->values[v][k] = lanes.values[v][lane];
        return true;
    }

    // Takes up to kLanes rays of one state; with `full` only where so many wait. False: there are none.
    HORD_ALWAYS_INLINE bool take(bool full, Packet<D>& packet) {
        Group* from = nullptr;  // the least advanced one: its rays may yet join the others
        for (Group& group : groups_) {
            if (group.count < (full ? kLanes : 1)) continue;
            if (from == nullptr || group.at.step < from->at.step) from = &group;
        }
        if (from == nullptr) return false;
        const unsigned count = std::min(from->count, kLanes);
        from->count -= count;
        const unsigned first = from->count;
        double values[8][kLanes];
        std::uint64_t path[kLanes];
        for (unsigned k = 0; k < kLanes; ++k) {
            const unsigned of = first + (k < count ? k : 0);
            for (int v = 0; v < 8; ++v) values[v][k] = from->values[v][of];
            path[k] = from->path[of];
            packet.index[k] = from->index[of];
        }
        packet.ray = {{algo::load<D>(values[0]), algo::load<D>(values[1]), algo::load<D>(values[2])},
                      {algo::load<D>(values[3]), algo::load<D>(values[4]), algo::load<D>(values[5])}};
        packet.weight = algo::load<D>(values[6]);
        packet.leaves = algo::load<D>(values[7]);
        packet.path = algo::load<decltype(packet.path)>(path);
        packet.lanes = (1U << count) - 1;
        packet.at = from->at;
        packet.alone = !full && static_cast<int>(count) < kFewest;
        return true;
    }

  private:
    static constexpr unsigned kGroups = 8, kRoom = 2 * kLanes;
    struct Group {
        PathState at;
        unsigned count = 0;
        std::uint32_t index[kRoom];
        double values[8][kRoom];  // origin, direction, weight, leaves
        std::uint64_t path[kRoom];
    };
    Group groups_[kGroups];
};

// 2 to kLanes rays from the camera on.
template <bool kLosses, class D>
HORD_ALWAYS_INLINE void start_packet(const Body& body, const CameraRay* rays, std::size_t first, unsigned count,
                                     Departed<D>& departed, Arrival* arrivals, [[maybe_unused]] Ghost ghost,
                                     Packet<D>& packet) {
    constexpr unsigned kLanes = kLaneCount<D>;
    double given[4][kLanes];
    for (unsigned k = 0; k < kLanes; ++k) {
        packet.index[k] = static_cast<std::uint32_t>(first + (k < count ? k : 0));
        const CameraRay& one = rays[packet.index[k]];
        given[0][k] = one.x, given[1][k] = one.y, given[2][k] = one.u, given[3][k] = one.v;
    }
    const D x = algo::load<D>(given[0]), y = algo::load<D>(given[1]), u = algo::load<D>(given[2]),
            v = algo::load<D>(given[3]);
    const double start = body.high.z;
    packet.ray = {{x + u * start, y + v * start, broadcast<D>(start)}, unit(Vec3Lanes<D>{-u, -v, broadcast<D>(-1)})};
    packet.weight = broadcast<D>(1);
    packet.leaves = leaves_box_from_above(body, packet.ray);
    decltype(packet.path) path{};
    path.a += kFreePath, path.b += kFreePath;
    packet.path = path;
    packet.at = {};
    unsigned lanes = (1U << count) - 1;
    const unsigned past = mask_bits(packet.leaves < 0) & lanes;
    each(past, [&](unsigned k) {
        const CameraRay& from = rays[packet.index[k]];
        arrivals[packet.index[k]] =
            kLosses && ghost.is_one() ? Arrival{} : Arrival{from.u, from.v, from.x, from.y, 1, kFreePath};
    });
    packet.lanes = lanes &= ~past;
    if (lanes == 0) return;
    std::uint64_t inside_bits[kLanes] = {};
    for (std::size_t s = 0; s < body.surfaces.size(); ++s)
        each(inside_of(body.surfaces[s], packet.ray.origin) & lanes,
             [&](unsigned k) { inside_bits[k] |= std::uint64_t{1} << s; });
    packet.at.inside_bits = inside_bits[std::countr_zero(lanes)];
    unsigned others = 0;
    each(lanes, [&](unsigned k) { others |= unsigned{inside_bits[k] != packet.at.inside_bits} << k; });
    if (others != 0) {
        Lanes<D> out(packet.ray, packet.weight, packet.leaves, packet.path);
        each(others, [&](unsigned k) {
            if (body.medium(inside_bits[k]) != 0) out.values[7][k] = kNever;
            if (!departed.add({inside_bits[k], 0, 0, 0}, packet.index[k], out, k))
                arrivals[packet.index[k]] = trace_even(body, rays[packet.index[k]], nullptr, ghost);
        });
        packet.lanes = lanes & ~others;
    }
    if (body.medium(packet.at.inside_bits) != 0) packet.leaves = broadcast<D>(kNever);
}

// Follows a packet until each of its rays has arrived, is lost or has departed. One long function: the state of all
// lanes is shared by every step and kept in registers.
template <bool kLosses, class D>
HORD_ALWAYS_INLINE void follow_packet(const Body& body, const CameraRay* rays, const Packet<D>& packet,
                                      Departed<D>& departed, Arrival* arrivals, [[maybe_unused]] Ghost ghost) {
    constexpr unsigned kLanes = kLaneCount<D>;
    RayLanes<D> ray = packet.ray;
    D weight = packet.weight, leaves = packet.leaves;
    auto path = packet.path;
    unsigned lanes = packet.lanes;
    std::uint64_t inside_bits = packet.at.inside_bits, on_bits = packet.at.on_bits;
    int step = packet.at.step;
    [[maybe_unused]] int faces = packet.at.faces;

    const auto lose = [&](unsigned of) __attribute__((always_inline)) {
        each(of, [&](unsigned k) { arrivals[packet.index[k]] = {}; });
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
            Arrival& arrival = arrivals[packet.index[k]];
            const CameraRay& from = rays[packet.index[k]];
            if (((back >> k) & 1U) != 0) arrival = {};
            else if (paths[k] == kFreePath) arrival = {from.u, from.v, from.x, from.y, out[4][k], kFreePath};
            else arrival = {out[0][k], out[1][k], out[2][k], out[3][k], out[4][k], paths[k]};
        });
    };

    const std::size_t surfaces = body.surfaces.size();
    const int most = max_crossings(body);
    std::uint8_t medium = body.medium(inside_bits);
    // Those in `alone` are followed here to their end.
    const auto depart = [&](unsigned of, unsigned alone) __attribute__((always_inline)) {
        const Lanes<D> out(ray, weight, leaves, path);
        const auto& v = out.values;
        each(of, [&](unsigned k) {
            const std::uint32_t index = packet.index[k];
            if (((alone >> k) & 1U) == 0 && departed.add({inside_bits, on_bits, step, faces}, index, out, k)) return;
            RayState state{{{v[0][k], v[1][k], v[2][k]}, {v[3][k], v[4][k], v[5][k]}},
                           v[6][k],
                           out.path[k],
                           inside_bits,
                           on_bits,
                           medium,
                           v[7][k],
                           step,
                           faces};
            arrivals[index] = continue_trace(body, state, nullptr, ghost) ? arrival_of(state, rays[index]) : Arrival{};
        });
    };
    D next[Body::kMaxSurfaces];
    for (;; ++step) {
        if (std::popcount(lanes) < kFewest) return depart(lanes, packet.alone ? lanes : 0);
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
        if (step == most) return lose(lanes);  // they never leave: caused by rounding only
        std::size_t first = 0;
        while (first + 1 < surfaces && ((mask_bits(next[first] == t) >> std::countr_zero(lanes)) & 1U) == 0) ++first;
        // Lanes with another first surface depart. Those with two that may coincide are followed alone from here.
        const D nearest = t + kCoincident * body.size;
        const auto meets = next[first] == t;
        auto clear = meets & (t < kNever);
        for (std::size_t s = 0; s < surfaces; ++s) {
            if (s != first) clear = clear & (next[s] > nearest);
        }
        unsigned same = mask_bits(clear) & lanes;
        const unsigned alone = mask_bits(meets) & lanes & ~same;

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
        if (const unsigned leave = lanes & ~same; leave != 0) {
            depart(leave, alone);
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

template <bool kLosses, class D>
HORD_ALWAYS_INLINE void trace_packets(const Body& body, const CameraRay* rays, std::size_t count, Arrival* arrivals,
                                      Ghost ghost) {
    Departed<D> departed;
    for (std::size_t k = 0;;) {
        Packet<D> packet;
        if (!departed.take(true, packet)) {
            const std::size_t some = std::min<std::size_t>(count - k, kLaneCount<D>);
            if (some > 1)
                start_packet<kLosses>(body, rays, k, static_cast<unsigned>(some), departed, arrivals, ghost, packet);
            else if (some == 1) arrivals[k] = trace_even(body, rays[k], nullptr, ghost);
            else if (!departed.take(false, packet)) return;
            k += some;
        }
        if (packet.lanes != 0) follow_packet<kLosses>(body, rays, packet, departed, arrivals, ghost);
    }
}

template <int Bytes>
HORD_ALWAYS_INLINE void trace_all(const Body& body, const CameraRay* rays, std::size_t count, Arrival* arrivals,
                                  Ghost ghost) {
    if (body.has_losses()) trace_packets<true, Doubles<Bytes>>(body, rays, count, arrivals, ghost);
    else trace_packets<false, Doubles<Bytes>>(body, rays, count, arrivals, ghost);
}

HORD_FOR_EACH_ISA(traced, trace_all)

}  // namespace

void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost, algo::Isa isa) {
    traced(isa)(body, rays.data(), rays.size(), arrivals, ghost);
    if (body.wave.u == 0 && body.wave.v == 0) return;
    for (std::size_t k = 0; k < rays.size(); ++k) add_waviness(body, rays[k], arrivals[k]);
}

void trace_many(const Body& body, std::span<const CameraRay> rays, Arrival* arrivals, Ghost ghost) {
    static const algo::Isa isa = algo::widest_isa();
    trace_many(body, rays, arrivals, ghost, isa);
}

}  // namespace hord::sim
