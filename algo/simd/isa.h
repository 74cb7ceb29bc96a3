// Instruction sets that the kernels are compiled for, chosen at run time. Whatever is chosen, every result has the same
// bits: lanes, their number and the order of operations are fixed; only how many lanes one instruction takes differs.
#pragma once

#include <cstdint>

namespace hord::algo {

// portable: SSE2 on x86-64, NEON on arm64; avx2: with BMI and POPCNT, as every processor has that has it; avx512: F,
// BW, DQ, VL and VBMI2 (Ice Lake, Zen 4).
enum class Isa : std::uint8_t { portable, avx2, avx512 };

bool has(Isa isa);
// The fastest as measured (docs/results/features.md): AVX2 where there is AVX2. AVX-512 is 1.1 to 1.2 times slower
// here: most of the work is scalar bookkeeping between short vectors.
Isa best_isa();
// The widest: for what is lanes from beginning to end, as comparing with a reference (algo/reference/template_fit.h),
// which AVX-512 makes an eighth faster, or what it has an instruction for (algo/emd/residual.h,
// algo/emd/sparse_hord.h).
Isa widest_isa();

}  // namespace hord::algo
