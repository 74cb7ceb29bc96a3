// A light field in Python: a macro-pixel frame in NumPy's memory, and its extents.
#pragma once

#include <string>

#include "algo/frame/extents.h"
#include "lab/python/module.h"

namespace hord::lab::python {

struct LightField {
    ArrayFrame frame;  // macro-pixels: sample (m, n, i, j) at column m*I + i, row n*J + j
    algo::Extents extents;
    double bin_rad = 0;  // one bin pitch; 0: not known
    std::string source;  // the file, or empty

    // A read-only view [n, m, j, i] of the samples.
    [[nodiscard]] py::array samples() const;
    // A second frame of the same extents and depth.
    [[nodiscard]] bool is_like(const LightField& other) const {
        return extents == other.extents && frame.view.bits == other.frame.view.bits;
    }
};

// `frame`: a LightField, which is returned, or what `hord.decode` (an array) and `hord.read` (a file) take.
LightField field_of(const py::object& frame, const py::object& bins, const py::object& grid, int bits);

}  // namespace hord::lab::python
