// The stock solvers that the earth mover's distance is measured against, each used the way that suits it best:
// buffers and tables are made once, and bins without mass are skipped.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/emd/ground_distance.h"
#include "algo/frame/hord.h"

namespace hord::bench {

// OpenCV's EMD (float, simplex). With `cancel` the mass that both share bin by bin is taken away first.
class CvPeer {
  public:
    CvPeer(const algo::GroundDistance& ground, bool cancel);
    double distance(const algo::Hord& a, const algo::Hord& b);

  private:
    const algo::GroundDistance& ground_;
    bool cancel_;
    std::vector<float> signature_[2];  // weight, x, y
};

// LEMON's NetworkSimplex. Costs are whole numbers (2^-32 of a bin pitch): on doubles it does not always end.
class LemonPeer {
  public:
    explicit LemonPeer(const algo::GroundDistance& ground);
    double distance(const algo::Hord& a, const algo::Hord& b);

  private:
    const algo::GroundDistance& ground_;
    std::vector<std::int64_t> cost_;
};

}  // namespace hord::bench
