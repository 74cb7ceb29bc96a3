// Small episodes that once violated an invariant, as reduced by the shrinker.
#pragma once

#include <array>
#include <string_view>

#include "lab/soak/plan.h"

namespace hord::lab {

struct Found {
    std::string_view bug;      // tests/system/mutants/BUG.patch plants it again; else what was wrong
    std::string_view promise;  // the invariant that was violated
    std::uint64_t seed, parts;
    LineProfile line;
    std::string_view faults;
};

inline constexpr std::array kFound{
    Found{"late-verdict-accepted", "own-data", 8410883890119106219U, 217, LineProfile::encoder,
          "inspector-slow@209+556000us"},
    Found{"touching-parts-unseen", "counters-agree", 7461442279635777055U, 34, LineProfile::encoder,
          "part-touching@24"},
    Found{"token-forgotten", "commands-once", 9950621557077242515U, 41, LineProfile::encoder, "plc-repeats@40"},
    Found{"permit-with-an-empty-line", "lawful-states", 17162889060386944605U, 3, LineProfile::encoder,
          "restart-ordered@1,plc-commands@2"},
    Found{"lost-edges-run-on", "no-bad-part-passes", 3439141232638176491U, 43, LineProfile::encoder, "edge-lost@33"},
    Found{"a reset of before the line stop cleared it in the same instant", "no-bad-part-passes", 12420840632199476735U,
          32, LineProfile::encoder, "plc-walks@19+1500000us,plc-walks@23+1500000us,process-stalled@23+400000us"},
    Found{"a ghost edge restarted the time for which the sensor was covered", "no-bad-part-passes",
          18167719296799697426U, 364, LineProfile::timed,
          "part-touching@33,part-touching@34-360:0.03,edge-ghost@343+55000us"},
    Found{"two losses were reported as one, with stored results between them", "one-story", 10963806530692724064U, 763,
          LineProfile::timed, "disk-full@550-740:0.03+3000000us,store-slow@705+4000000us"},
    Found{"a part told after the permit was withdrawn was called ejected", "unconfirmed-stops", 14609013737187424158U,
          5000, LineProfile::timed,
          "ejector-stuck@24,ejector-stuck@25-416:0.01,process-stalled@239+120000us,process-stalled@240-4500:0.03+"
          "400000us"},
    Found{"an arrival that was lost behind a ghost edge was taken for a leaving edge", "no-bad-part-passes",
          5966409901995310801U, 1496, LineProfile::encoder,
          "process-crash@304+150000us,edge-lost@1485,edge-ghost@1429-1522:0.03+55000us"},
    Found{"the observer, told late of a part that had left, did not know the line stop between", "no-bad-part-passes",
          14815787824337216300U, 270, LineProfile::timed,
          "plc-walks@5+1500000us,plc-walks@142-276:0.03+2500000us,process-stalled@140-274:0.03+400000us"},
    Found{"the same of the observer, with an encoder", "no-bad-part-passes", 14161075918074502693U, 178,
          LineProfile::encoder, "plc-walks@111-199:0.03+1500000us,process-stalled@169-179:0.03+400000us"},
    Found{"the observer counted the time for which the belt stood as a part's way", "true-reasons",
          14489981575578618572U, 97, LineProfile::encoder, "plc-commands@5,encoder-slip@88+20000us"},
    Found{"a part that came as the permit fell kept its place on a belt that stood", "no-bad-part-passes",
          12055965908620561094U, 3507, LineProfile::timed,
          "plc-orders@398+2500000us,plc-orders@399-4500:0.01+100000us"},
    Found{"the ejector of the simulated cell hit a part that the feeder held", "bounded", 6249567308676188721U, 377,
          LineProfile::encoder,
          "trigger-late@277+101000us,trigger-late@278-372:0.03+101000us,reject-late@56+100000us,strobe-dead@276,"
          "inspector-failed@277,plc-orders@278+100000us,plc-orders@279-467:0.01+2500000us"},
    Found{"the observer did not know that a part with which the belt stood just before the camera cannot be exposed",
          "true-reasons", 1284110683102184671U, 1465, LineProfile::encoder,
          "strobe-refused@401,strobe-refused@1135-1501:0.002,inspector-hangs@402+400000us,"
          "inspector-hangs@1444+1500000us"},
    Found{"the observer counted the time for which the belt stood between a ghost edge and the part behind it",
          "true-reasons", 7233871483661870434U, 387, LineProfile::encoder,
          "edge-ghost@378+30000us,strobe-lost@376+700000us,plc-orders@378+1000000us"},
};

inline Result<EpisodePlan> plan_of(const Found& found) {
    auto faults = faults_of(found.faults);
    if (!faults) return tl::unexpected(faults.error());
    return EpisodePlan{found.seed, found.parts, found.line, false, std::move(*faults)};
}

}  // namespace hord::lab
