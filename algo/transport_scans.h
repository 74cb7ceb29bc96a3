// The loops of the transportation simplex that run over whole rows of costs: eight lanes at a time, for every instruction set.
//
// Rows are padded to whole vectors. Eight running sums or minima are kept and folded in a fixed order at the end, so that all
// instruction sets give the same bits.
#pragma once

#include <cstdint>

#include "algo/isa.h"

namespace hord::algo {

constexpr int kScanLanes = 8;  // doubles
constexpr double kPadding = 1e300;  // a cost that is never chosen

struct TransportScans {
    // cost[j] = table[bin[j]] for j < count, kPadding up to stride. Returns the sum of weight[j] * cost[j], and adds
    // share * cost[j] to mean[j].
    double (*gather)(const double* table, const std::uint8_t* bin, int count, int stride, const double* weight, double share,
                     double* cost, double* mean);
    // key[j] = cost[j] - mean_row - mean[j], its 16 low bits replaced by row * 256 + j: an order, and what it is the order of.
    void (*keys)(const double* cost, const double* mean, double mean_row, int row, int stride, double* key);
    // The least of key[j] + shut[j].
    double (*least)(const double* key, const double* shut, int stride);
    // The least of 0 and the reduced costs cost[i][j] - v[j] - u[i] over rows first <= i < last; *row: where it is.
    double (*least_reduced)(const double* cost, const double* u, const double* v, int first, int last, int stride, int* row);
};
TransportScans transport_scans(Isa isa);

}  // namespace hord::algo
