// What the search for the part's outline knows of a lenslet (rim.cpp, tube_outline.cpp, plate_outline.cpp). Bits
// combine.
#pragma once

#include <cstdint>

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

}  // namespace hord::algo::outline
