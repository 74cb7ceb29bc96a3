// Calibrations in Python.
#pragma once

#include "calib/files/grid_toml.h"
#include "lab/python/module.h"

namespace hord::lab::python {

// A calibration: found by hord.calibrate(), or read from its file.
struct Calibration {
    calib::GridFile file;
    std::vector<std::string> warnings;  // of hord.calibrate()
};

// `grid`: a Calibration, or its file.
calib::GridFile grid_of(const py::object& grid);

}  // namespace hord::lab::python
