#include "lab/soak/simulated_line.h"

#include <utility>

#include "hal_sim/world/random.h"

namespace hord::lab {

using namespace std::chrono_literals;
using sim::InjectedFault;

namespace {

constexpr std::uint64_t kMomentStream = 0xD1E5;

}  // namespace

LineOptions timed_line(std::uint64_t seed, std::uint64_t parts) {
    LineOptions line;
    sim::CellOptions& cell = line.cell;
    cell.seed = seed;
    cell.schedule.parts = parts;
    cell.schedule.pitch_jitter = 0.2;
    cell.schedule.kinds = {{"good", false, 9}, {"bad", true, 1}};
    cell.rejector.permit_moves_belt = true;
    cell.geometry.ejector_reach_mm =
        2;  // 4 ms to either side: less than the pulse, else a pulse that began too late would still hit
    cell.part_sensor.latency = 200us;
    cell.strobe.report = {20us, 50us};
    cell.strobe.limits.min_rest =
        64ms;  // a little more than min_gap allows: the light refuses some parts that are close
    cell.sensor.readout = {3ms, 2ms};
    cell.rejector.write = {300us, 2ms};

    CoreConfig& core = line.core;
    core.strobe = cell.strobe.nominal_pulse;
    core.strobe_window = 20us;
    core.exposure_delay = cell.camera_delay() - core.strobe_delay - core.strobe / 2;
    core.transport = cell.ejector_delay();
    core.frame_timeout = 50ms;
    core.min_gap = 60ms;   // 30 mm: beyond what the camera and the ejector could confuse
    core.max_part = 60ms;  // a part is 20 mm long
    core.frame_window = 2ms;
    return line;
}

LineOptions encoder_line(std::uint64_t seed, std::uint64_t parts) {
    LineOptions line = timed_line(seed, parts);
    constexpr double kCountsPerMm = 20;
    line.cell.part_sensor.encoder_counts_per_mm = kCountsPerMm;
    line.cell.part_sensor.encoder_every = 5ms;
    line.cell.conveyor.jitter = 0.02;
    line.cell.geometry.ejector_reach_mm = 6;  // between two readings the position is extrapolated
    line.core.by_encoder = true;
    const auto counts = [&](double mm) { return static_cast<std::int64_t>(mm * kCountsPerMm); };
    line.core.exposure_counts = counts(line.cell.geometry.camera_mm);
    line.core.transport_counts = counts(line.cell.geometry.ejector_mm);
    line.core.min_gap_counts = counts(30);
    line.core.max_part_counts = counts(30);
    return line;
}

// Reports each frame that goes to the inspector and each judgement that comes back to the invariants.
class SimulatedLine::ObservedInspector final : public Inspector, Inspector::Listener {
  public:
    ObservedInspector(std::unique_ptr<Inspector> inner, SimulatedLine& line) : inner_(std::move(inner)), line_(line) {}

    void start(Inspector::Listener& listener) override {
        listener_ = &listener;
        inner_->start(*this);
    }
    Result<void> submit(std::uint32_t part, hal::FrameLease frame) override {
        const hal::FrameInfo info = frame.info();
        if (line_.alive()) {
            const sim::SimSensor& sensor = line_.cell_->sensor();
            line_.invariants_->submitted(part, info,
                                         {sensor.true_part_of(info.sequence), sensor.true_trigger_of(info.sequence)});
        }
        return inner_->submit(part, std::move(frame));
    }
    void stop() override { inner_->stop(); }

  private:
    void on_judged(const Judged& judged) override {
        if (line_.alive()) line_.invariants_->judged(judged);
        listener_->on_judged(judged);
    }

    std::unique_ptr<Inspector> inner_;
    SimulatedLine& line_;
    Inspector::Listener* listener_ = nullptr;
};

Result<std::unique_ptr<SimulatedLine>> SimulatedLine::make(const LineOptions& options) {
    auto line = std::unique_ptr<SimulatedLine>(new SimulatedLine(options));
    if (auto done = line->assemble(); !done) return tl::unexpected(done.error());
    return line;
}

SimulatedLine::~SimulatedLine() {
    if (alive()) process_->proxies->cut();
}

Result<void> SimulatedLine::assemble() {
    if (const auto wrong = problems(options_.core); !wrong.empty())
        return fail(ErrorCode::invalid_argument, wrong.front());
    auto cell = sim::SimulatedCell::make(loop_, options_.frames != nullptr ? *options_.frames : tokens_, options_.cell);
    if (!cell) return tl::unexpected(cell.error());
    cell_ = std::move(*cell);
    invariants_ =
        std::make_unique<Invariants>(Invariants::Rules{options_.frames == nullptr, options_.core, 64}, *cell_, loop_);
    cell_->faults().watch([this](InjectedFault fault, Duration amount) { invariants_->fault(fault, amount); });
    store_observer_.emplace(loop_, *invariants_);
    cell_->watch({.part_edge =
                      [this](const sim::PartRecord& part, bool arrives, hal::TimePoint) {
                          if (arrives) part_arrives(part);
                      },
                  .part_gone = [this](const sim::PartRecord& part) { invariants_->part_is_gone(part); },
                  .ejector = {}});
    plc_.emplace(loop_, *invariants_, *store_observer_, options_.cell.seed);
    plc_->clear_with([this] { take_parts_off(); });
    orders_.emplace(
        loop_, *plc_, options_.cell.seed,
        OrderedStops::Effects{
            .feed = [this](bool on) { cell_->world().feed(on); },
            .interferes = [this](Duration amount) { invariants_->fault(InjectedFault::plc_orders, amount); }});
    loop_.call_after(PlcSimulator::kCycle, [this] { plc_cycle(); });
    return start_process(false);
}

void SimulatedLine::plc_cycle() {
    loop_.call_after(PlcSimulator::kCycle, [this] { plc_cycle(); });
    plc_->cycle();
}

void SimulatedLine::take_parts_off() {
    cell_->world().take_off([](const sim::PartRecord&) { return true; });
}

// -- processes

Result<void> SimulatedLine::start_process(bool line_unknown) {
    auto judging = make_stand_in_inspector(
        loop_, options_.queue, [this](std::uint32_t part, const hal::FrameLease& frame) { return judge(part, frame); });
    ++processes_;
    process_.reset();  // destroys the one before, its members in reverse order
    process_ = Process{};
    Process& process = *process_;
    process.proxies = std::make_unique<DeviceProxies>(*cell_, *invariants_);
    process.inspector = std::make_unique<ObservedInspector>(std::move(judging), *this);
    DeviceProxies& proxies = *process.proxies;
    process.station = std::make_unique<Station>(
        options_.core,
        Cell{loop_, proxies.part_sensor(), proxies.strobe(), proxies.sensor(), proxies.rejector(), *process.inspector},
        this);
    const auto boot = static_cast<std::uint32_t>(0x10001U + processes_);
    store_observer_->open(boot, *process.station, [this](std::uint32_t faults) {
        process_->station->outside_faults(faults);
        process_->plc_endpoint->publish();
    });
    process.plc_endpoint = std::make_unique<PlcEndpoint>(loop_, options_.core, boot);
    process.plc_endpoint->open(*process.station, *process.inspector, *store_observer_);
    plc_->connect(process.plc_endpoint.get());
    invariants_->process_starts(process.station->core(), options_.core);
    if (line_unknown) process.station->line_unknown();
    process.station->run();
    return {};
}

// From now on nothing that the process does has an effect. Its objects are destroyed later, when no call is active in
// them.
void SimulatedLine::end_process(Duration down_for, bool line_unknown) {
    if (!alive()) return;
    process_->alive = false;
    process_->proxies->cut();
    store_observer_->detach();
    plc_->connect(nullptr);
    invariants_->process_ends();
    was_stopped_ = false;
    loop_.call_after({}, [this] {
        process_->plc_endpoint.reset();
        store_observer_->destroy_recorder();
        process_->station.reset();
        process_->inspector.reset();
    });
    loop_.call_after(options_.module_watchdog, [this] { process_->proxies->close_rejector(); });
    loop_.call_after(std::max(down_for, 2 * options_.module_watchdog),
                     [this, line_unknown] { (void)start_process(line_unknown); });
}

// Halt and start again, as after a change of the configuration. A clean end leaves a note whether parts are on the
// line.
void SimulatedLine::restart_cleanly() {
    if (!alive()) return;
    process_->station->request(Command::halt);
    const bool empty = process_->station->core().line().size() == 0 && !snapshot().line_stop;
    options_.core.reject_pulse = processes_ % 2 == 1 ? milliseconds(14) : milliseconds(15);
    options_.core.frame_timeout = processes_ % 2 == 1 ? milliseconds(55) : milliseconds(50);
    store_observer_->close();
    end_process(milliseconds(200), !empty);
}

// -- faults by part

void SimulatedLine::part_arrives(const sim::PartRecord& part) {
    invariants_->part_arrives(part);
    sim::InjectionPlan& faults = cell_->faults();
    if (const auto amount = faults.fires(InjectedFault::process_stalled)) loop_.stall(*amount);
    if (const auto amount = faults.fires(InjectedFault::process_crash)) {
        const std::uint64_t moment = sim::random_bits(options_.cell.seed, kMomentStream, drawn_++);
        const auto dies = [this, down_for = *amount] { end_process(down_for, true); };
        if (moment % 2 == 0 && alive())
            process_->proxies->after_calls(static_cast<int>(moment / 2 % 6), dies);  // during a step
        else loop_.call_after(Duration(static_cast<Duration::rep>(moment % 100'000'000)), dies);
    }
    if (faults.fires(InjectedFault::restart_ordered)) loop_.call_after({}, [this] { restart_cleanly(); });
    if (const auto amount = faults.fires(InjectedFault::plc_silent)) plc_->be_silent(*amount);
    if (faults.fires(InjectedFault::plc_repeats)) loop_.call_after({}, [this] { plc_->repeat_a_command(); });
    if (faults.fires(InjectedFault::plc_commands)) loop_.call_after({}, [this] { plc_->misuse_commands(); });
    if (const auto amount = faults.fires(InjectedFault::plc_walks))
        loop_.call_after({}, [this, stays = *amount] { plc_->walk_states(stays); });
    if (const auto amount = faults.fires(InjectedFault::plc_orders))
        loop_.call_after({}, [this, stays = *amount] { orders_->order(stays); });
    if (const auto amount = faults.fires(InjectedFault::device_unplugged)) unplug_something(*amount);
    if (faults.fires(InjectedFault::plc_nonsense)) loop_.call_after({}, [this] { plc_->write_nonsense(); });
    if (faults.fires(InjectedFault::scada_floods)) plc_->read_everything();
    for (const InjectedFault fault : {InjectedFault::store_error, InjectedFault::store_in_doubt,
                                      InjectedFault::store_slow, InjectedFault::disk_full, InjectedFault::clock_set}) {
        if (const auto amount = faults.fires(fault)) store_observer_->apply_fault(fault, *amount);
    }
}

// At a random time, also while the device is idle.
void SimulatedLine::unplug_something(Duration amount) {
    const std::uint64_t draw = sim::random_bits(options_.cell.seed, kMomentStream, drawn_++);
    loop_.call_after(Duration(static_cast<Duration::rep>(draw % 1'500'000'000)),
                     [this, amount, device = static_cast<Device>(draw >> 32U & 3U)] {
                         invariants_->fault(InjectedFault::device_unplugged, amount);
                         switch (device) {
                             case Device::part_sensor: return cell_->unplug_part_sensor(amount);
                             case Device::strobe: return cell_->strobe().unplug(amount);
                             case Device::sensor: return cell_->sensor().unplug(amount);
                             case Device::rejector: return cell_->rejector().unplug(amount);
                         }
                     });
}

StandInAnswer SimulatedLine::judge(std::uint32_t part, const hal::FrameLease& frame) {
    StandInAnswer answer;
    answer.judged = options_.judge ? options_.judge(part, frame) : judge_by_token(frame);
    if (cell_->faults().fires(InjectedFault::inspector_failed)) answer.judged.failed = true;
    answer.after =
        options_.inspection + cell_->faults().fires(InjectedFault::inspector_slow).value_or(Duration::zero());
    if (const auto amount = cell_->faults().fires(InjectedFault::inspector_hangs))
        hangs_until_ = std::max(hangs_until_, loop_.now() + *amount);
    answer.after = std::max(answer.after, hangs_until_ - loop_.now());
    return answer;
}

Judged SimulatedLine::judge_by_token(const hal::FrameLease& frame) const {
    Judged judged;
    const auto token = sim::TokenFrames::read(frame.view());
    if (!token) {
        judged.reason = frame.view().sample(0, 0) == 0 ? algo::Reason::too_dark : algo::Reason::saturated;
    } else if (token->part == 0) {
        judged.reason = algo::Reason::nothing_to_see;
    } else {
        judged.verdict = token->bad ? algo::Verdict::reject : algo::Verdict::pass;
        judged.reason = token->bad ? algo::Reason::neighbours_disagree : algo::Reason::none;
    }
    return judged;
}

bool SimulatedLine::run() {
    const auto& cell = options_.cell;
    const double belt_mm = static_cast<double>(cell.schedule.parts) * cell.schedule.pitch_mm + cell.geometry.exit_mm;
    const hal::TimePoint limit = loop_.now() + 20 * cell.travel(belt_mm) + 60s;
    const bool over = loop_.run_until(
        [this] {
            return invariants_->time_stands_still() ||
                (cell_->finished() && alive() && process_->station->core().line().size() == 0);
        },
        limit);
    if (invariants_->time_stands_still()) return false;
    loop_.run_until(
        std::max(loop_.now() + 2s, store_observer_->calm_from()));  // time for a last reset and for writing the queue
    if (alive()) store_observer_->end(snapshot());
    invariants_->end();
    return over;
}

// -- the person who resets

void SimulatedLine::schedule_reset() {
    if (!std::exchange(reset_scheduled_, true)) loop_.call_after(options_.reset_after, [this] { reset_line(); });
}

// Resets a station that has stopped; after line stop takes the parts off first.
void SimulatedLine::reset_line() {
    reset_scheduled_ = false;
    if (!alive()) return;
    const State state = process_->station->core().state();
    if (state != State::error && state != State::initialized) return;
    watch_line_stop();
    ++resets_;
    if (process_->station->core().line_stop()) take_parts_off();
    process_->station->request(Command::reset);
    if (alive() && !executing(process_->station->core().state())) schedule_reset();
}

void SimulatedLine::watch_line_stop() {
    const bool stopped = process_->station->core().line_stop();
    if (stopped && !was_stopped_) ++line_stops_;
    was_stopped_ = stopped;
}

void SimulatedLine::on_result(const PartResult& result) {
    if (!alive()) return;
    invariants_->result(result);
    store_observer_->on_result(result);
    plc_->expect_result(result);
    process_->plc_endpoint->add_result(result);
    publish_soon();
    if (keep_results_) results_.push_back(result);
}

// After the core has finished its step, as in the service.
void SimulatedLine::publish_soon() {
    loop_.post([this, process = processes_] {
        if (alive() && process == processes_) process_->plc_endpoint->publish();
    });
}

void SimulatedLine::on_fault(std::uint32_t raised, const Snapshot& now) {
    if (alive()) store_observer_->fault(raised, now.line_stop_why);
}

void SimulatedLine::on_state(State from, State to) {
    if (!alive()) return;
    store_observer_->state(from, to, snapshot().faults_active);
    publish_soon();
    if (to == State::continuous_execution && !std::exchange(line_started_, true)) cell_->start();
    watch_line_stop();
    if (to == State::error) schedule_reset();
}

void SimulatedLine::on_step(State before, const Event& event) {
    if (!alive()) return;
    coverage_.stepped(before, event);
    invariants_->stepped(before, event);
    orders_->stepped(process_->station->core());
}

}  // namespace hord::lab
