// Frames whose even and odd rows show the lenslets in two places: interlaced fields of an array that moved, or a sensor
// that reads every second row late.
#pragma once

#include "calib/lattice/white_image.h"

namespace hord::calib {

struct RowShift {
    double px = 0;     // of even rows against odd ones, along x
    double sigma = 0;  // its standard error
};

// From the light itself, without a lattice. With D the difference along a row and S the second difference across rows,
// the sum of D(I) S(I) over a frame is 0 for any light, because D is antisymmetric and S symmetric. Rows that alternate
// by d add d D(I) to S(I) with alternating sign. Shifts up to a tenth of a lenslet are right to a fifth; larger ones
// are not 0. Only some rows of high frames are read. All 0 for frames of less than 16 rows.
RowShift row_shift(const WhiteImage& image);

}  // namespace hord::calib
