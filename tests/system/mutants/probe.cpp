// Runs the soak until a promise is broken, and says how many parts that took.
//
//     mutant-NAME [--expect-violation] [--shrink] [--parts N] [--seed N]
//     mutant-NAME --found NAME              whether the example of tests/system/scenario/found/found.h still shows this
//     bug
//
// Exit status: 0 as expected, 1 not, 2 it could not run.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "lab/soak/shrink.h"
#include "lab/soak/soak.h"
#include "tests/system/scenario/found/found.h"

namespace {

using namespace hord;
using namespace hord::lab;
using namespace hord::firmware;

int show_found(std::string_view bug) {
    for (const Found& found : kFound) {
        if (found.bug != bug) continue;
        const auto plan = plan_of(found);
        const auto breakage = plan ? try_episode(*plan) : tl::unexpected(plan.error());
        if (!breakage) return 2;
        std::printf("%s: %s\n", command_of(*plan).c_str(), breakage->promise.c_str());
        return breakage->promise == found.promise ? 0 : 1;
    }
    std::fprintf(stderr, "tests/system/scenario/found/found.h has no example of this bug\n");
    return 2;
}

}  // namespace

int main(int count, char** arguments) {
    bool expected = false, shrinks = false;
    SoakOptions options;
    options.parts = 100'000;
    options.parts_an_episode = 500;
    options.until_violation = true;
    options.real_parts = false;
    for (int k = 1; k < count; ++k) {
        if (std::strcmp(arguments[k], "--expect-violation") == 0) {
            expected = true;
        } else if (std::strcmp(arguments[k], "--shrink") == 0) {
            shrinks = true;
        } else if (std::strcmp(arguments[k], "--found") == 0 && k + 1 < count) {
            return show_found(arguments[++k]);
        } else if (std::strcmp(arguments[k], "--parts") == 0 && k + 1 < count) {
            options.parts = std::strtoull(arguments[++k], nullptr, 10);
        } else if (std::strcmp(arguments[k], "--seed") == 0 && k + 1 < count) {
            options.seed = std::strtoull(arguments[++k], nullptr, 10);
        } else {
            std::fprintf(stderr, "%s: unknown argument %s\n", arguments[0], arguments[k]);
            return 2;
        }
    }
    const auto report = soak(options);
    if (!report) {
        std::fprintf(stderr, "%s\n", report.error().message().c_str());
        return 2;
    }
    if (report->violations == 0) {
        std::printf("%llu parts, no promise broken, fingerprint %016llx\n",
                    static_cast<unsigned long long>(report->parts),
                    static_cast<unsigned long long>(report->fingerprint));
    } else {
        std::printf("%llu parts: %s\n", static_cast<unsigned long long>(report->parts_to_violation),
                    report->first_violations.front().c_str());
    }
    if (shrinks && report->first_broken) {
        const auto shrunk = shrink(*report->first_broken, try_episode);
        if (!shrunk || shrunk->plan.parts > report->first_broken->parts) return 1;
        std::printf("shrunk in %llu runs: %s\n", static_cast<unsigned long long>(shrunk->runs),
                    command_of(shrunk->plan).c_str());
    }
    return (report->violations > 0) == expected ? 0 : 1;
}
