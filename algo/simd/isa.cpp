#include "algo/simd/isa.h"

namespace hord::algo {

bool has(Isa isa) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") &&
        __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("popcnt");
    if (isa == Isa::avx2) return avx2;
    if (isa == Isa::avx512) {
        return avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
            __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
            __builtin_cpu_supports("avx512vbmi2");
    }
#endif
    return isa == Isa::portable;
}

Isa best_isa() { return has(Isa::avx2) ? Isa::avx2 : Isa::portable; }
Isa widest_isa() { return has(Isa::avx512) ? Isa::avx512 : best_isa(); }

}  // namespace hord::algo
