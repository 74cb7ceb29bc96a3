// What a dark bin reads: the part of the sensor's reading noise above the dark level.
#pragma once

namespace hord::algo {

struct ClippedNoise {
    double mean = 0, variance = 0;
};

// Of max(0, z - clip), z normal with the mean 0 and this variance, above 0. The same bits on every machine.
ClippedNoise clipped_noise(double variance, double clip);

}  // namespace hord::algo
