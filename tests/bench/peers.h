// The stock solvers that our EMD is compared with, each used in its fastest way: buffers and tables are made once, and
// bins without mass are skipped.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/emd/ground_distance.h"
#include "algo/frame/hord.h"

namespace hord::bench {

// OpenCV's EMD (float, simplex). `cancel`: subtracts the mass shared in each bin first.
class CvPeer {
  public:
    CvPeer(const algo::GroundDistance& ground, bool cancel);
    double distance(const algo::Hord& a, const algo::Hord& b);

  private:
    const algo::GroundDistance& ground_;
    bool cancel_;
    std::vector<float> signature_[2];  // weight, x, y
};

// LEMON's NetworkSimplex. Costs are integers (2^-32 of a bin pitch): with doubles it does not always terminate.
class LemonPeer {
  public:
    explicit LemonPeer(const algo::GroundDistance& ground);
    double distance(const algo::Hord& a, const algo::Hord& b);

  private:
    const algo::GroundDistance& ground_;
    std::vector<std::int64_t> cost_;
};

}  // namespace hord::bench
