// The experiments that `hord-lab experiment` offers.
#pragma once

#include <span>

#include "lab/experiment/experiment.h"

namespace hord::lab {

// In the order in which --help lists them.
std::span<const Experiment> experiments();

}  // namespace hord::lab
