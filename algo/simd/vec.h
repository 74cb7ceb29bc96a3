// A fixed number of lanes, in as many vectors as the instruction set needs, folded in a fixed order: every instruction
// set gives the same bits. For kernels' .cpp files only.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "algo/simd/multiversion.h"

namespace hord::algo {

template <class T, int Count, int Bytes, class Parts = std::make_index_sequence<Count * sizeof(T) / Bytes>>
struct Lanes;

// Count of T, held in vectors of Bytes.
template <class T, int Count, int Bytes, std::size_t... I>
struct Lanes<T, Count, Bytes, std::index_sequence<I...>> {
    static constexpr int kEach = Bytes / static_cast<int>(sizeof(T));
    static_assert(kEach * sizeof...(I) == Count);
    using V = Vector<T, Bytes>;
    V part[sizeof...(I)];

    HORD_ALWAYS_INLINE static Lanes all(T value) {
        V v{};
        v[0] = value;
        v = first_everywhere(
            v, std::make_index_sequence<kEach>{});  // one broadcast; V{} + value is an insertion a lane in GCC 12
        return {{(static_cast<void>(I), v)...}};
    }
    // The same of *from, where whole vectors can be read: one instruction less.
    HORD_ALWAYS_INLINE static Lanes all_of(const T* from) {
        const V v = first_everywhere(load<V>(from), std::make_index_sequence<kEach>{});
        return {{(static_cast<void>(I), v)...}};
    }
    // 0, 1, 2, ...
    HORD_ALWAYS_INLINE static Lanes numbers() {
        static constexpr std::array<T, Count> kNumbers = [] {
            std::array<T, Count> n{};
            for (std::size_t l = 0; l < Count; ++l) n[l] = static_cast<T>(l);
            return n;
        }();
        return at(kNumbers.data());
    }
    // 1, 2, 4, ...
    HORD_ALWAYS_INLINE static Lanes powers_of_two() {
        static constexpr std::array<T, Count> kPowers = [] {
            std::array<T, Count> n{};
            for (std::size_t l = 0; l < Count; ++l) n[l] = static_cast<T>(T{1} << l);
            return n;
        }();
        return at(kPowers.data());
    }
    HORD_ALWAYS_INLINE static Lanes at(const T* from) { return {{load<V>(from + I * kEach)...}}; }
    HORD_ALWAYS_INLINE void to(T* here) const { (store(part[I], here + I * kEach), ...); }

    HORD_ALWAYS_INLINE Lanes operator+(const Lanes& b) const { return {{(part[I] + b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator-(const Lanes& b) const { return {{(part[I] - b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator*(const Lanes& b) const { return {{(part[I] * b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator&(const Lanes& b) const { return {{(part[I] & b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator|(const Lanes& b) const { return {{(part[I] | b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator^(const Lanes& b) const { return {{(part[I] ^ b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes operator>>(int bits) const { return {{(part[I] >> bits)...}}; }
    // All bits where it is true, else none.
    HORD_ALWAYS_INLINE Lanes equals(const Lanes& b) const { return {{(part[I] == b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes above(const Lanes& b) const { return {{(part[I] > b.part[I])...}}; }
    HORD_ALWAYS_INLINE Lanes<std::int32_t, Count, Bytes> below(const Lanes& b) const
        requires(sizeof(T) == sizeof(std::int32_t)) {
        return {{static_cast<Vector<std::int32_t, Bytes>>(part[I] < b.part[I])...}};
    }
    HORD_ALWAYS_INLINE friend Lanes choose(const Lanes& bits, const Lanes& yes, const Lanes& no) {
        return {{((bits.part[I] & yes.part[I]) | (~bits.part[I] & no.part[I]))...}};
    }
    HORD_ALWAYS_INLINE Lanes operator<<(int bits) const { return {{(part[I] << bits)...}}; }
    HORD_ALWAYS_INLINE friend Lanes lower(const Lanes& a, const Lanes& b) {
        return {{(b.part[I] < a.part[I] ? b.part[I] : a.part[I])...}};
    }
    HORD_ALWAYS_INLINE friend Lanes higher(const Lanes& a, const Lanes& b) {
        return {{(a.part[I] < b.part[I] ? b.part[I] : a.part[I])...}};
    }

    // The same bits, or the same values towards zero, as another type.
    template <class To>
    HORD_ALWAYS_INLINE Lanes<To, Count, Bytes> bits_as() const {
        return {{__builtin_bit_cast(Vector<To, Bytes>, part[I])...}};
    }
    template <class To>
    HORD_ALWAYS_INLINE Lanes<To, Count, Bytes> converted() const {
        return {{__builtin_convertvector(part[I], Vector<To, Bytes>)...}};
    }

    HORD_ALWAYS_INLINE T least() const {
        V v = part[0];
        ((v = part[I] < v ? part[I] : v), ...);
        return fold<kEach / 2>(v);
    }
    // Those that any lane has.
    HORD_ALWAYS_INLINE T all_bits() const {
        V v = part[0];
        ((v = v | part[I]), ...);
        return fold_bits<kEach / 2>(v);
    }
    // In an order that is the same for every width: halves are added until one is left.
    HORD_ALWAYS_INLINE T sum() const {
        V sums[] = {part[I]...};
        for (std::size_t half = sizeof...(I) / 2; half > 0; half /= 2) {
            for (std::size_t k = 0; k < half; ++k) sums[k] = sums[k] + sums[k + half];
        }
        return fold_sum<kEach / 2>(sums[0]);
    }

  private:
    template <std::size_t... L>
    HORD_ALWAYS_INLINE static V first_everywhere(V v, std::index_sequence<L...>) {
        return __builtin_shufflevector(v, v, static_cast<int>(L * 0)...);
    }
    template <int Distance, std::size_t... L>
    HORD_ALWAYS_INLINE static V rotated(V v, std::index_sequence<L...>) {
        return __builtin_shufflevector(v, v, static_cast<int>((L + Distance) % kEach)...);
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold_bits(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            return fold_bits<Distance / 2>(v | rotated<Distance>(v, std::make_index_sequence<kEach>{}));
        }
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold_sum(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            return fold_sum<Distance / 2>(v + rotated<Distance>(v, std::make_index_sequence<kEach>{}));
        }
    }
    template <int Distance>
    HORD_ALWAYS_INLINE static T fold(V v) {
        if constexpr (Distance == 0) {
            return v[0];
        } else {
            const V other = rotated<Distance>(v, std::make_index_sequence<kEach>{});
            return fold<Distance / 2>(other < v ? other : v);
        }
    }
};

}  // namespace hord::algo
