// Runs a line to its end and checks the requirements common to all scenarios.
#pragma once

#include <gtest/gtest.h>

#include "lab/soak/simulated_line.h"

namespace hord::lab {

inline std::unique_ptr<SimulatedLine> run_scenario(const LineOptions& options) {
    auto made = SimulatedLine::make(options);
    if (!made) {
        ADD_FAILURE() << made.error().message();
        return nullptr;
    }
    auto line = std::move(*made);
    line->keep_results(true);
    EXPECT_TRUE(line->run()) << "the line did not come to its end";
    for (const std::string& violation : line->invariants().first_violations()) ADD_FAILURE() << violation;
    for (const sim::InjectedFault fault : line->cell().faults().never_fired())
        ADD_FAILURE() << sim::name_of(fault) << " never fired";
    return line;
}

// `fault` at the opportunities [first, last], counted from 0.
inline sim::InjectionRule always(sim::InjectedFault fault, std::uint64_t first, std::uint64_t last,
                                 Duration amount = {}) {
    return {fault, 1, first, last, amount};
}

}  // namespace hord::lab
