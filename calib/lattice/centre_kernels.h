// What centres.cpp and lenslet_light.cpp share: the weights of a finder, and the pixels of one lenslet.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Dense>

#include "calib/lattice/centre_weights.h"

namespace hord::calib {

// Response of one window to the kernels of one phase (see CentreFinder::Kernels::bank).
struct Responses {
    float x = 0, y = 0, amplitude = 0, power = 0;
};

// The pixels of the window about a centre, with the radial tables at their places.
struct WindowPixels {
    struct Pixel {
        double dx, dy, shape, window, light, weight, steepness;
    };
    std::vector<Pixel> pixels;
    double background = 0, amplitude = 0;  // of the profile, by least squares
};

// The weights, sampled for every sub-pixel phase; each a window of `side` x `side` floats.
struct CentreFinder::Kernels {
    explicit Kernels(const WhiteImage& of);

    const WhiteImage* image;
    Weights weights;
    AgainstGradients against = AgainstGradients::where_cheap;
    int half = 0, side = 0, phases = 16;
    Eigen::Index size = 0;
    Responses (*respond)(const float*, const float*, std::ptrdiff_t);  // with the widest vectors of this machine
    double gain = 0;       // first moment a pixel of shift and DN of amplitude
    double own_match = 1;  // keeps `match` in -1..1
    double typical_amplitude = 0;
    double halves = 1, halves_light = 1;  // noise_of_halves() of the centre and of the light
    // Four kernels a phase: moment x, moment y, amplitude, window share.
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic> bank;
    mutable Eigen::VectorXf light;  // of the window that is measured, side x side and room for whole vectors

    void sample(const Weights& from);
    struct Moments {
        double x = 0, y = 0, amplitude = 0, match = 0;
        algo::PixelPoint about;
    };
    [[nodiscard]] Moments moments(algo::PixelPoint at) const;
    [[nodiscard]] bool complete(algo::PixelPoint at) const;
    [[nodiscard]] std::optional<Spot> measure(algo::PixelPoint at, double most_px) const;
    [[nodiscard]] std::optional<WindowPixels> pixels_about(algo::PixelPoint centre) const;
    [[nodiscard]] std::optional<algo::PixelPoint> split(algo::PixelPoint centre) const;
    [[nodiscard]] double noise_of_halves(const std::function<double(double dx, double dy)>& weight) const;
    void learn_noise_of_halves();
    [[nodiscard]] std::optional<double> light_noise(algo::PixelPoint centre) const;
    [[nodiscard]] std::optional<Elongation> elongation(algo::PixelPoint centre) const;
    [[nodiscard]] double turned(algo::PixelPoint centre) const;
    void calibrate_gain(std::span<const algo::PixelPoint> centres);
};

}  // namespace hord::calib
