#include "firmware/soak/simulated_line.h"

#include <utility>

namespace hord::firmware {

using namespace std::chrono_literals;

LineOptions timed_line(std::uint64_t seed, std::uint64_t parts) {
    LineOptions line;
    sim::CellOptions& cell = line.cell;
    cell.seed = seed;
    cell.schedule.parts = parts;
    cell.schedule.pitch_jitter = 0.2;
    cell.schedule.kinds = {{"good", false, 9}, {"bad", true, 1}};
    cell.rejector.permit_moves_belt = true;
    cell.part_sensor.latency = 200us;
    cell.strobe.report = {20us, 50us};
    cell.sensor.readout = {3ms, 2ms};
    cell.rejector.write = {300us, 2ms};

    CoreConfig& core = line.core;
    core.strobe = cell.strobe.nominal_pulse;
    core.strobe_window = 20us;
    core.exposure_delay = cell.camera_delay() - core.strobe_delay - core.strobe / 2;
    core.transport = cell.ejector_delay();
    core.frame_timeout = 50ms;
    core.min_gap = 60ms;      // 30 mm: more than the camera and the ejector can confuse
    core.frame_window = 2ms;
    return line;
}

LineOptions encoder_line(std::uint64_t seed, std::uint64_t parts) {
    LineOptions line = timed_line(seed, parts);
    constexpr double kCountsPerMm = 20;
    line.cell.part_sensor.encoder_counts_per_mm = kCountsPerMm;
    line.cell.part_sensor.encoder_every = 5ms;
    line.cell.conveyor.jitter = 0.02;
    line.core.by_encoder = true;
    const auto counts = [&](double mm) { return static_cast<std::int64_t>(mm * kCountsPerMm); };
    line.core.exposure_counts = counts(line.cell.geometry.camera_mm);
    line.core.transport_counts = counts(line.cell.geometry.ejector_mm);
    line.core.min_gap_counts = counts(30);
    return line;
}

// Sees every frame on its way to the inspector, and knows which part is truly in it.
class SimulatedLine::Witness final : public Inspector {
  public:
    Witness(std::unique_ptr<Inspector> inner, SimulatedLine& line) : inner_(std::move(inner)), line_(line) {}

  private:
    void do_start(Listener& listener) override { inner_->start(listener); }
    Result<void> do_submit(std::uint32_t part, hal::FrameLease frame) override {
        line_.invariants_->frame_inspected(part, line_.cell_->sensor().true_part_of(frame.info().sequence));
        return inner_->submit(part, std::move(frame));
    }
    void do_stop() override { inner_->stop(); }

    std::unique_ptr<Inspector> inner_;
    SimulatedLine& line_;
};

Result<std::unique_ptr<SimulatedLine>> SimulatedLine::make(const LineOptions& options) {
    auto line = std::unique_ptr<SimulatedLine>(new SimulatedLine(options));
    if (auto done = line->assemble(); !done) return tl::unexpected(done.error());
    return line;
}

SimulatedLine::~SimulatedLine() = default;

Result<void> SimulatedLine::assemble() {
    if (const auto wrong = problems(options_.core); !wrong.empty()) return fail(ErrorCode::invalid_argument, wrong.front());
    auto cell = sim::SimulatedCell::make(loop_, options_.frames != nullptr ? *options_.frames : tokens_, options_.cell);
    if (!cell) return tl::unexpected(cell.error());
    cell_ = std::move(*cell);
    invariants_ = std::make_unique<Invariants>(cell_->faults(), options_.frames == nullptr);
    cell_->watch({.part_edge =
                      [this](const sim::PartRecord& part, bool arrives, hal::TimePoint) {
                          if (arrives) invariants_->part_arrives(part);
                      },
                  .part_gone =
                      [this](const sim::PartRecord& part) { invariants_->part_is_gone(part, cell_->rejector().run_permit()); },
                  .ejector = {}});
    std::unique_ptr<Inspector> judging;
    if (options_.inspector) {
        auto made = options_.inspector(loop_);
        if (!made) return tl::unexpected(made.error());
        judging = std::move(*made);
    } else {
        judging = make_stand_in_inspector(loop_, options_.queue,
                                          [this](std::uint32_t part, const hal::FrameLease& frame) { return judge(part, frame); });
    }
    inspector_ = std::make_unique<Witness>(std::move(judging), *this);
    station_ = std::make_unique<Station>(
        options_.core, Cell{loop_, cell_->part_sensor(), cell_->strobe(), cell_->sensor(), cell_->rejector(), *inspector_}, this);
    return {};
}

StandInAnswer SimulatedLine::judge(std::uint32_t part, const hal::FrameLease& frame) {
    StandInAnswer answer;
    const auto token = sim::TokenFrames::read(frame.view());
    if (!token) {
        answer.judged.reason = frame.view().sample(0, 0) == 0 ? algo::Reason::too_dark : algo::Reason::saturated;
    } else if (token->part == 0) {
        answer.judged.reason = algo::Reason::nothing_to_see;
    } else {
        answer.judged.verdict = token->bad ? algo::Verdict::reject : algo::Verdict::pass;
        answer.judged.reason = token->bad ? algo::Reason::deflection : algo::Reason::none;
    }
    const bool slow = part >= options_.slow_first && part <= options_.slow_last;
    slow_inspections_ += slow ? 1U : 0U;
    answer.after = slow ? options_.slow_inspection : options_.inspection;
    return answer;
}

bool SimulatedLine::run() {
    station_->run();
    const auto& cell = options_.cell;
    const double belt_mm = static_cast<double>(cell.schedule.parts) * cell.schedule.pitch_mm + cell.geometry.exit_mm;
    const hal::TimePoint limit = loop_.now() + 20 * cell.travel(belt_mm) + 60s;
    const bool over = loop_.run_until([this] { return cell_->finished() && station_->core().line().size() == 0; }, limit);
    loop_.run_for(2s);  // a last reset
    invariants_->end(station_->core(), cell_->strobe().longest_on(), cell.strobe.limits.max_on);
    return over;
}

// The person looks at a station that has stopped, takes parts off where line stop says so, and resets it.
void SimulatedLine::look_after_the_line() {
    person_is_coming_ = false;
    const State state = station_->snapshot().state;
    if (state != State::error && state != State::initialized) return;
    watch_line_stop();
    ++resets_;
    (void)station_->command(Command::reset);
    if (!executing(station_->snapshot().state) && !std::exchange(person_is_coming_, true)) {
        loop_.call_after(options_.reset_after, [this] { look_after_the_line(); });
    }
}

void SimulatedLine::watch_line_stop() {
    const bool stopped = station_->snapshot().line_stop;
    if (stopped) invariants_->line_is_stopped(loop_.now());
    if (stopped && !was_stopped_) ++line_stops_;
    was_stopped_ = stopped;
}

void SimulatedLine::on_result(const PartResult& result) {
    watch_line_stop();
    invariants_->result(result, station_->core(), loop_.now());
    if (keep_) kept_.push_back(result);
}

void SimulatedLine::on_state(State, State to) {
    if (to == State::continuous_execution) cell_->start();
    watch_line_stop();
    if (to != State::error) return;
    if (!std::exchange(person_is_coming_, true)) loop_.call_after(options_.reset_after, [this] { look_after_the_line(); });
}

}  // namespace hord::firmware
