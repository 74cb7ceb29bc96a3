#include "hal_sim/cell/cell.h"

#include <string>
#include <utility>

namespace hord::sim {
namespace {

using namespace std::chrono_literals;

std::string problems_of(const CellOptions& o, const FrameSource::Format& format) {
    std::string text;
    const auto need = [&](bool good, const char* what) {
        if (good) return;
        if (!text.empty()) text += "; ";
        text += what;
    };
    need(o.conveyor.speed_mm_s > 0, "conveyor.speed_mm_s must be above 0");
    need(o.conveyor.jitter >= 0 && o.conveyor.jitter < 1, "conveyor.jitter must be in [0, 1)");
    need(o.conveyor.jitter_every > 0ns, "conveyor.jitter_every must be above 0");
    for (std::size_t k = 0; k < o.conveyor.stops.size(); ++k) {
        const auto& stop = o.conveyor.stops[k];
        need(stop.length > 0ns && stop.after >= 0ns, "conveyor.stops need a positive length");
        need(k == 0 || stop.after >= o.conveyor.stops[k - 1].after + o.conveyor.stops[k - 1].length,
             "conveyor.stops must be in order and apart");
    }
    const auto& s = o.schedule;
    need(s.first_mm >= 0, "schedule.first_mm must not be negative");
    need(s.pitch_jitter >= 0 && s.pitch_jitter < 1, "schedule.pitch_jitter must be in [0, 1)");
    need(s.part_length_mm > 0 && s.part_length_mm < s.pitch_mm * (1 - s.pitch_jitter),
         "schedule.part_length_mm must be above 0 and below the smallest pitch");
    double share = 0;
    for (const PartKind& kind : s.kinds) {
        need(kind.share >= 0, "schedule.kinds need shares of at least 0");
        share += kind.share;
    }
    need(share > 0, "schedule.kinds need one kind with a share above 0");
    const auto& g = o.geometry;
    need(g.camera_mm > 0 && g.camera_reach_mm > 0 && g.ejector_reach_mm > 0,
         "geometry's places and reaches must be above 0");
    need(g.camera_mm < g.ejector_mm && g.ejector_mm + g.ejector_reach_mm < g.exit_mm,
         "geometry must be in the order camera, ejector, exit");
    need(o.part_sensor.encoder_counts_per_mm >= 0 && o.part_sensor.encoder_every > 0ns,
         "part_sensor's encoder is impossible");
    const auto& limits = o.strobe.limits;
    need(limits.max_on > 0ns && limits.min_rest >= 0ns && limits.channels >= 1 && limits.channels <= 32 &&
             o.strobe.nominal_pulse > 0ns,
         "strobe.limits are impossible");
    need(o.sensor.buffers >= 1, "sensor.buffers must be at least 1");
    need(format.width_px > 0 && format.height_px > 0 && format.bits >= 8 && format.bits <= 16,
         "the frame source's format is impossible");
    for (const InjectionRule& rule : o.faults) {
        need(rule.probability >= 0 && rule.probability <= 1 && rule.first <= rule.last && rule.amount >= 0ns,
             "faults need a probability in [0, 1], first <= last and no negative amount");
    }
    return text;
}

}  // namespace

Result<std::unique_ptr<SimulatedCell>> SimulatedCell::make(hal::EventLoop& loop, FrameSource& frames,
                                                           const CellOptions& options) {
    if (const std::string text = problems_of(options, frames.format()); !text.empty()) {
        return fail(ErrorCode::invalid_argument, "simulated cell: " + text,
                    "correct the options of the simulated cell");
    }
    return std::unique_ptr<SimulatedCell>(new SimulatedCell(loop, frames, options));
}

SimulatedCell::SimulatedCell(hal::EventLoop& loop, FrameSource& frames, const CellOptions& options)
    : faults_(options.seed, options.faults),
      world_(loop, faults_, options.conveyor, options.schedule, options.geometry, options.seed),
      part_sensor_(loop, world_, faults_, options.part_sensor), strobe_(loop, faults_, options.strobe, options.seed),
      sensor_(loop, world_, strobe_, frames, faults_, options.sensor, options.seed),
      rejector_(loop, world_, faults_, options.rejector, options.seed) {
    watch({});
}

void SimulatedCell::watch(World::Watchers watchers) {
    watchers.part_edge = [this, also = std::move(watchers.part_edge)](const PartRecord& part, bool arrives,
                                                                      hal::TimePoint at) {
        if (also) also(part, arrives, at);
        if (arrives ? !part.touches_ahead : !part.touched_behind) part_sensor_.part_edge(arrives, at);
    };
    world_.watch(std::move(watchers));
}

}  // namespace hord::sim
