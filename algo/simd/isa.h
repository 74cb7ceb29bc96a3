// Instruction sets that the kernels are compiled for, chosen at run time. Every result has the same bits on each of
// them: the number of lanes and the order of operations are fixed, only the lanes per instruction differ.
#pragma once

#include <cstdint>

namespace hord::algo {

// portable: SSE2 on x86-64, NEON on arm64.
// avx2: with BMI and POPCNT, which every processor with AVX2 has.
// avx512: F, BW, DQ, VL and VBMI2 (Ice Lake, Zen 4).
enum class Isa : std::uint8_t { portable, avx2, avx512 };

bool has(Isa isa);
// The fastest as measured (docs/results/features.md): AVX2 where available. AVX-512 is 1.1 to 1.2 times slower for most
// kernels, which are scalar bookkeeping between short vectors.
Isa best_isa();
// The widest. For kernels that are vectors throughout (algo/reference/template_fit.h) or that use an AVX-512
// instruction, such as compress (algo/emd/residual.h, algo/emd/sparse_hord.h).
Isa widest_isa();

}  // namespace hord::algo
