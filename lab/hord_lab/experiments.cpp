#include "lab/hord_lab/experiments.h"

#include "lab/ablation/ablation.h"
#include "lab/detection/detection.h"
#include "lab/guarantee/guarantee.h"
#include "lab/kinds/kinds.h"
#include "lab/paper/paper.h"
#include "lab/reference/reference.h"
#include "lab/stability/stability.h"
#include "lab/tradeoff/tradeoff.h"
#include "lab/tradeoff/tradeoff_whole.h"

namespace hord::lab {

std::span<const Experiment> experiments() {
    static constexpr Experiment kExperiments[] = {
        {"paper", "The paper's figure: which of its claims hold, and for which light and bubbles",
         "about one minute on two cores", run_paper},
        {"tradeoff", "Speed against accuracy: every feature over light, bins, slopes, strides and frames; and cells",
         "about fifteen minutes on two cores (estimated from its parts)", run_tradeoff},
        {"whole", "Whole parts through the station's pipeline: false rejects, misses and time of each recipe",
         "about fifteen minutes on one core", run_whole},
        {"detection",
         "Judging against a reference: false rejects, bubbles, kinds, slopes, contrast and time on simulated "
         "production",
         "about twenty-five minutes on one core (estimated from its parts)", run_detection},
        {"guarantee",
         "Does the bound of false rejects hold that learn and tune tell, and which flaws are found at limits from 60 "
         "parts? Ten "
         "families, a hundred seeds",
         "about twenty minutes on two cores", run_guarantee},
        {"reference",
         "Judging light fields of another program against a reference: false rejects, flaws, place and size",
         "about four minutes on one core (estimated from its quick form)", run_reference},
        {"ablation", "What each physical effect does to detection, and what it costs", "about two minutes on two cores",
         run_ablation},
        {"kinds", "The simulated line's kinds of defect: which camera or feature sees each, and why it is rejected",
         "about half a minute on two cores", run_kinds},
        {"stability", "Do the features keep their promises at the extremes? A table of case, expected, got, verdict",
         "a minute and a half", run_stability},
    };
    return kExperiments;
}

}  // namespace hord::lab
