// Starts of transport problems, side by side: the steps that transport_simplex.h begins with, the same to the last of them, for 16 problems of
// one shape at once, a lane each. One problem alone is left to the simplex; of sixteen, a start takes half to three
// quarters of the time here (17 x 19).
//
// Formats are those of transport_simplex.h: costs are integers whose low bits are the cell's row and column; mean costs of rows and columns are
// floats, added up in the order in which the simplex adds them.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "algo/isa.h"

namespace hord::algo {

// A step of a start: a row and a column exchange `flow`, which uses up one of them: of a tie the column, unless it is the last.
struct TransportStep {
    double flow = 0;
    std::int16_t row = 0;
    std::int16_t column = 0;
    bool row_used_up = false;  // else the column
};

// Costs as integers. Their low bits, the tag, are left to the cell's row and column.
struct TransportCosts {
    static constexpr std::int32_t kLargest = 1 << 27;

    const std::int32_t* table = nullptr;  // a row of `stride` for each bin
    int stride = 0;
};
struct TransportTag {
    int col_bits;
    std::int32_t all;
    TransportTag(int rows, int cols) : col_bits(bits_for((cols + 7) / 8 * 8)), all((1 << (col_bits + bits_for(rows))) - 1) {}

  private:
    static int bits_for(int count) { return std::bit_width(static_cast<unsigned>(count - 1)); }
};

constexpr int kMostStartSide = 24;  // most rows and columns of problems side by side
constexpr int kMostStarts = 16;     // of them at once

// Problems of one shape.
struct TransportBatch {
    struct Side {
        std::array<double, kMostStartSide> mass;  // positive integers below 2^53
        std::array<std::uint8_t, kMostStartSide> bin;
    };
    struct Problem {
        Side rows, cols;  // their masses add up to the same
    };
    int rows = 0, cols = 0;  // 2..kMostStartSide
    int filled = 0;
    std::array<Problem, kMostStarts> problem;
};

// rows + cols - 1 steps of each problem.
using TransportStarts = std::array<std::array<TransportStep, 2 * kMostStartSide - 1>, kMostStarts>;

using FindStarts = void (*)(const TransportCosts& costs, const TransportBatch& batch, TransportStarts& starts);
FindStarts find_starts_for(Isa isa);

}  // namespace hord::algo
