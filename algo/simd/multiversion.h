// The words for one machine vector, and the macro that compiles a kernel for every instruction set. Include in kernels'
// .cpp files only. Names follow Google Highway. Fixed numbers of lanes: algo/simd/vec.h.
//
// HORD_FOR_EACH_ISA(NAME, RETURN, BODY, SIGNATURE, ARGUMENTS) compiles the always-inlined template BODY<vector bytes>
// for each instruction set and defines NAME(Isa), which returns a pointer to the matching function.
#pragma once

#include <cstring>
#include <type_traits>

#include "algo/simd/isa.h"

#define HORD_ALWAYS_INLINE [[gnu::always_inline]] inline

namespace hord::algo {

// GCC's vector of T with Bytes bytes; T itself where Bytes is sizeof(T).
template <class T, int Bytes>
struct VectorOf {
    using type __attribute__((vector_size(Bytes))) = T;
};
template <class T, int Bytes>
requires(Bytes == sizeof(T)) struct VectorOf<T, Bytes> {
    using type = T;
};
template <class T, int Bytes>
using Vector = typename VectorOf<T, Bytes>::type;

template <class V, class T>
HORD_ALWAYS_INLINE V load(const T* from) {
    V v;
    std::memcpy(&v, from, sizeof(v));
    return v;
}
template <class V, class T>
HORD_ALWAYS_INLINE void store(const V& v, T* to) {
    std::memcpy(to, &v, sizeof(v));
}
template <class V>
HORD_ALWAYS_INLINE V min(const V& a, const V& b) {
    return b < a ? b : a;
}
template <class V>
HORD_ALWAYS_INLINE V max(const V& a, const V& b) {
    return a < b ? b : a;
}

}  // namespace hord::algo

#if defined(__x86_64__)
#define HORD_AVX2 "avx2,bmi,bmi2,popcnt"
// Clang does not know prefer-vector-width and would ignore the whole list.
#if defined(__clang__)
#define HORD_AVX512 HORD_AVX2 ",avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2"
#else
#define HORD_AVX512 HORD_AVX2 ",avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2,prefer-vector-width=512"
#endif
#define HORD_FOR_EACH_ISA(NAME, RETURN, BODY, SIGNATURE, ARGUMENTS)                                   \
    [[gnu::target(HORD_AVX2)]] static RETURN NAME##_avx2 SIGNATURE { return BODY<32> ARGUMENTS; }     \
    [[gnu::target(HORD_AVX512)]] static RETURN NAME##_avx512 SIGNATURE { return BODY<64> ARGUMENTS; } \
    static RETURN NAME##_portable SIGNATURE { return BODY<16> ARGUMENTS; }                            \
    static auto NAME(::hord::algo::Isa isa) {                                                         \
        return isa == ::hord::algo::Isa::avx512 ? NAME##_avx512                                       \
            : isa == ::hord::algo::Isa::avx2    ? NAME##_avx2                                         \
                                                : NAME##_portable;                                       \
    }
#else
#define HORD_FOR_EACH_ISA(NAME, RETURN, BODY, SIGNATURE, ARGUMENTS)        \
    static RETURN NAME##_portable SIGNATURE { return BODY<16> ARGUMENTS; } \
    static auto NAME(::hord::algo::Isa) { return NAME##_portable; }
#endif
