// What the search for the part's outline knows of a lenslet (rim.cpp, tube_outline.cpp, plate_outline.cpp). Bits
// combine.
#pragma once

#include <algorithm>
#include <cstdint>

#include "algo/features/deflection.h"
#include "algo/inspection/rim.h"

namespace hord::algo::outline {

enum State : std::uint8_t {
    kFree = 1,       // shows free light
    kWide = 2,       // all its neighbours in the field are kFree, too: the flood fill passes through it
    kReached = 4,    // free field
    kUnreached = 8,  // all else
    kPart = 16,      // in a region of the part's outline; once the outline is closed, the part itself
    kInside = 32,    // part, or enclosed by part
    kCounted = 64,   // in a region whose size is known
    kFlank = 128,    // of a tube: too dark or too steep to be judged
};

// Mean deflections within a tolerance of one along one axis.
struct RawRange {
    RawRange(DeflectionQ middle, std::int64_t tolerance)
        : least(static_cast<std::int32_t>(std::max<std::int64_t>(middle.raw() - tolerance, INT32_MIN))),
          most(static_cast<std::int32_t>(std::min<std::int64_t>(middle.raw() + tolerance, INT32_MAX))) {}
    [[nodiscard]] bool has(DeflectionQ value) const { return (value.raw() >= least) & (value.raw() <= most); }
    std::int32_t least, most;
};

// Light that is deflected like the free light, within kFreeToleranceBins.
struct NearFree {
    static constexpr auto kTolerance =
        static_cast<std::int64_t>(kFreeToleranceBins * (1 << DeflectionQ::kFractionBits));
    explicit NearFree(const Deflection& free) : x(free.x, kTolerance), y(free.y, kTolerance) {}
    [[nodiscard]] bool has(const Deflection& d) const { return x.has(d.x) & y.has(d.y); }
    RawRange x, y;
};

}  // namespace hord::algo::outline
