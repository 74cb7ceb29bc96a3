// What is said of the single lenslets of a grid: which are saturated, blemished, displaced or missing, how many there
// are of each, and what the two halves of their light say. Used by calib/calibrate/calibrate_grid.cpp only.
#pragma once

#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/calibrate/calibrate_grid.h"
#include "calib/calibrate/local_finders.h"

namespace hord::calib {

// Counts saturated lenslets, and measures a sample of the lenslets by halves, for the shifts of single ones.
void measure_more(const WhiteImage& image, const LocalFinders& finders, const algo::LensletGrid& grid, double pitch,
                  GridCalibration& out);

// CentreFinder::light_noise() of the lenslets that were measured by halves.
std::vector<double> light_noise(const LocalFinders& finders, double pitch, const GridCalibration& of);

// Counts the lenslets inside the frame, and those of them that are complete, measured and missing.
void count_lenslets(const LocalFinders& finders, double pitch, GridCalibration& out);

// Finds the blemished and the displaced lenslets among the outliers of the fit, and counts the fully lit lenslets.
void place_and_count(const LocalFinders& finders, double pitch, GridCalibration& out);

}  // namespace hord::calib
