// The words for one machine vector, and the macro that compiles a kernel for every instruction set. Include in kernels'
// .cpp files only. Names follow Google Highway. Fixed numbers of lanes: algo/simd/vec.h.
//
// HORD_FOR_EACH_ISA(NAME, BODY, types...) compiles the always-inlined template BODY<vector bytes, types...> for each
// instruction set and defines NAME(Isa), which returns a pointer to the matching function.
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

// `v`; if it is a mask of 64 bytes, the compiler does not know its origin: GCC 12 combines two comparisons of such
// vectors lane by lane, in general registers.
template <class V>
HORD_ALWAYS_INLINE V as_lanes(V v) {
#if defined(__x86_64__) && !defined(__clang__)
    if constexpr (sizeof(V) == 64 && std::is_integral_v<std::remove_cvref_t<decltype(v[0])>>) asm("" : "+v"(v));
#endif
    return v;
}

#if defined(__x86_64__)
#define HORD_AVX2 "avx2,bmi,bmi2,popcnt"
// Clang does not know prefer-vector-width and would ignore the whole list.
#if defined(__clang__)
#define HORD_AVX512 HORD_AVX2 ",avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2"
#else
#define HORD_AVX512 HORD_AVX2 ",avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2,prefer-vector-width=512"
#endif
#endif

// The functions of one kernel. Body is called with the vector bytes, as an integral constant, and the arguments.
template <class Function, class Body>
struct IsaVariants;
template <class R, class... Arguments, class Body>
struct IsaVariants<R (*)(Arguments...), Body> {
    using Function = R (*)(Arguments...);
    template <int Bytes>
    using VectorBytes = std::integral_constant<int, Bytes>;
    static R portable(Arguments... arguments) { return Body{}(VectorBytes<16>{}, arguments...); }
#if defined(__x86_64__)
    [[gnu::target(HORD_AVX2)]] static R avx2(Arguments... arguments) { return Body{}(VectorBytes<32>{}, arguments...); }
    [[gnu::target(HORD_AVX512)]] static R avx512(Arguments... arguments) {
        return Body{}(VectorBytes<64>{}, arguments...);
    }
    static Function choose(Isa isa) { return isa == Isa::avx512 ? avx512 : isa == Isa::avx2 ? avx2 : portable; }
#else
    static Function choose(Isa) { return portable; }
#endif
};

}  // namespace hord::algo

#define HORD_FOR_EACH_ISA(NAME, BODY, ...)                                                                          \
    constexpr auto NAME =                                                                                           \
        ::hord::algo::IsaVariants<decltype(&BODY<16 __VA_OPT__(, ) __VA_ARGS__>),                                   \
                                  decltype([](auto bytes, auto&... arguments) __attribute__((always_inline)) {      \
                                      return BODY<decltype(bytes)::value __VA_OPT__(, ) __VA_ARGS__>(arguments...); \
                                  })>::choose;
