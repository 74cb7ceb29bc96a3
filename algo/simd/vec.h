// Vec<T, Count, Bytes>: Count lanes of T in as many machine vectors of Bytes as needed. Reductions fold in a fixed
// order: every instruction set gives the same bits. Names follow Google Highway. Include in kernels' .cpp files only.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "algo/simd/multiversion.h"

namespace hord::algo {

template <class T, int Count, int Bytes, class Parts = std::make_index_sequence<Count * sizeof(T) / Bytes>>
struct Vec;

template <class T, int Count, int Bytes, std::size_t... I>
struct Vec<T, Count, Bytes, std::index_sequence<I...>> {
    static constexpr int kEach = Bytes / static_cast<int>(sizeof(T));
    static_assert(kEach * sizeof...(I) == Count);
    using V = Vector<T, Bytes>;
    V part[sizeof...(I)];

    HORD_ALWAYS_INLINE static Vec broadcast(T value) {
        V v{};
        v[0] = value;
        v = broadcast_lane_0(v, std::make_index_sequence<kEach>{});  // GCC 12 inserts lane by lane for V{} + value
        return {{(static_cast<void>(I), v)...}};
    }
    // *from in every lane; reads a whole vector, which saves one instruction.
    HORD_ALWAYS_INLINE static Vec broadcast_first(const T* from) {
        const V v = broadcast_lane_0(algo::load<V>(from), std::make_index_sequence<kEach>{});
        return {{(static_cast<void>(I), v)...}};
    }
    // 0, 1, 2, ...
    HORD_ALWAYS_INLINE static Vec iota() {
        static constexpr std::array<T, Count> kIota = [] {
            std::array<T, Count> n{};
            for (std::size_t l = 0; l < Count; ++l) n[l] = static_cast<T>(l);
            return n;
        }();
        return load(kIota.data());
    }
    // 1, 2, 4, ...
    HORD_ALWAYS_INLINE static Vec powers_of_two() {
        static constexpr std::array<T, Count> kPowers = [] {
            std::array<T, Count> n{};
            for (std::size_t l = 0; l < Count; ++l) n[l] = static_cast<T>(T{1} << l);
            return n;
        }();
        return load(kPowers.data());
    }
    HORD_ALWAYS_INLINE static Vec load(const T* from) { return {{algo::load<V>(from + I * kEach)...}}; }
    // Loads narrower numbers and converts them.
    template <class From>
    HORD_ALWAYS_INLINE static Vec load_converted(const From* from) {
        return {{__builtin_convertvector((algo::load<Vector<From, kEach * sizeof(From)>>(from + I * kEach)), V)...}};
    }
    HORD_ALWAYS_INLINE void store(T* to) const { (algo::store(part[I], to + I * kEach), ...); }

    HORD_ALWAYS_INLINE Vec operator+(const Vec& b) const { return {{(part[I] + b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator-(const Vec& b) const { return {{(part[I] - b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator*(const Vec& b) const { return {{(part[I] * b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator*(T b) const { return {{(part[I] * b)...}}; }
    HORD_ALWAYS_INLINE Vec operator&(const Vec& b) const { return {{(part[I] & b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator|(const Vec& b) const { return {{(part[I] | b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator^(const Vec& b) const { return {{(part[I] ^ b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec operator>>(int bits) const { return {{(part[I] >> bits)...}}; }
    // Masks: all bits of a lane set where true, else none.
    HORD_ALWAYS_INLINE Vec equal_to(const Vec& b) const { return {{as_lanes(part[I] == b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec greater_than(const Vec& b) const { return {{as_lanes(part[I] > b.part[I])...}}; }
    HORD_ALWAYS_INLINE Vec<std::int32_t, Count, Bytes> less_than(const Vec& b) const
        requires(sizeof(T) == sizeof(std::int32_t)) {
        return {{as_lanes(static_cast<Vector<std::int32_t, Bytes>>(part[I] < b.part[I]))...}};
    }
    HORD_ALWAYS_INLINE friend Vec select(const Vec& mask, const Vec& yes, const Vec& no) {
        return {{((mask.part[I] & yes.part[I]) | (~mask.part[I] & no.part[I]))...}};
    }
    HORD_ALWAYS_INLINE Vec operator<<(int bits) const { return {{(part[I] << bits)...}}; }
    HORD_ALWAYS_INLINE friend Vec min(const Vec& a, const Vec& b) {
        return {{(b.part[I] < a.part[I] ? b.part[I] : a.part[I])...}};
    }
    HORD_ALWAYS_INLINE friend Vec max(const Vec& a, const Vec& b) {
        return {{(a.part[I] < b.part[I] ? b.part[I] : a.part[I])...}};
    }

    // The same bits as another type; or the values converted, rounded towards zero.
    template <class To>
    HORD_ALWAYS_INLINE Vec<To, Count, Bytes> bit_cast() const {
        return {{__builtin_bit_cast(Vector<To, Bytes>, part[I])...}};
    }
    template <class To>
    HORD_ALWAYS_INLINE Vec<To, Count, Bytes> convert() const {
        return {{__builtin_convertvector(part[I], Vector<To, Bytes>)...}};
    }

    HORD_ALWAYS_INLINE T reduce_min() const {
        V v = part[0];
        ((v = part[I] < v ? part[I] : v), ...);
        return fold_min<kEach / 2>(v);
    }
    HORD_ALWAYS_INLINE T reduce_or() const {
        V v = part[0];
        ((v = v | part[I]), ...);
        return fold_or<kEach / 2>(v);
    }
    // Adds halves until one lane is left: the same order for every width.
    HORD_ALWAYS_INLINE T reduce_sum() const {
        V sums[] = {part[I]...};
        for (std::size_t half = sizeof...(I) / 2; half > 0; half /= 2) {
            for (std::size_t k = 0; k < half; ++k) sums[k] = sums[k] + sums[k + half];
        }
        return fold_sum<kEach / 2>(sums[0]);
    }

  private:
    template <std::size_t... L>
    HORD_ALWAYS_INLINE static V broadcast_lane_0(V v, std::index_sequence<L...>) {
        return __builtin_shufflevector(v, v, static_cast<int>(L * 0)...);
    }
    template <int Distance, std::size_t... L>
    HORD_ALWAYS_INLINE static V rotate(V v, std::index_sequence<L...>) {
        return __builtin_shufflevector(v, v, static_cast<int>((L + Distance) % kEach)...);
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold_or(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            return fold_or<Distance / 2>(v | rotate<Distance>(v, std::make_index_sequence<kEach>{}));
        }
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold_sum(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            return fold_sum<Distance / 2>(v + rotate<Distance>(v, std::make_index_sequence<kEach>{}));
        }
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold_min(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            const V other = rotate<Distance>(v, std::make_index_sequence<kEach>{});
            return fold_min<Distance / 2>(other < v ? other : v);
        }
    }
};

}  // namespace hord::algo
