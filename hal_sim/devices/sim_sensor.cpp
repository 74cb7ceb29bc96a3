#include "hal_sim/devices/sim_sensor.h"

#include <algorithm>
#include <cstring>

#include "hal_sim/world/random.h"

namespace hord::sim {

using hal::Duration;
using hal::TimePoint;
using namespace std::chrono_literals;

SimSensor::SimSensor(hal::EventLoop& loop, World& world, const SimStrobe& strobe, FrameSource& source,
                     InjectionPlan& faults, const SensorOptions& options, std::uint64_t seed)
    : loop_(loop), world_(world), strobe_(strobe), source_(source), faults_(faults), options_(options), seed_(seed),
      latency_(options.readout, seed, 0x5E45),
      slots_(std::make_unique<Slot[]>(static_cast<std::size_t>(options.buffers))) {
    const FrameSource::Format format = source_.format();
    const auto bytes = static_cast<std::size_t>(format.width_px) * static_cast<std::size_t>(format.height_px) *
        (format.bits > 8 ? 2U : 1U);
    for (int k = 0; k < options_.buffers; ++k) slots_[static_cast<std::size_t>(k)].samples.resize(bytes);
    if (faults_.names(InjectedFault::frame_stale)) last_samples_.resize(bytes);
}

hal::SensorFormat SimSensor::format() const {
    const FrameSource::Format format = source_.format();
    return {format.width_px, format.height_px, format.bits, options_.buffers};
}

Result<void> SimSensor::do_start(Listener& listener) {
    if (loop_.now() < back_at_)
        return fail(ErrorCode::not_found, "simulated sensor is gone", "start it again when it is back");
    listener_ = &listener;
    lost_ = false;
    sequence_ = 0;
    return {};
}

SimSensor::Slot* SimSensor::take_free() {
    for (int k = 0; k < options_.buffers; ++k) {
        Slot& slot = slots_[static_cast<std::size_t>(k)];
        if (slot.state.load(std::memory_order_acquire) == State::free) return &slot;
    }
    return nullptr;
}

Result<void> SimSensor::do_trigger(const hal::ExposureRequest& request) {
    if (lost_) return fail(ErrorCode::disconnected, "simulated sensor is gone", "stop it and start it again");
    Slot* slot = take_free();
    if (slot == nullptr)
        return fail(ErrorCode::busy, "every frame buffer is lent or filling",
                    "give frames back sooner, or set more buffers");
    if (const auto amount = faults_.fires(InjectedFault::sensor_lost)) {
        lose(*amount);
        return {};  // accepted; the loss is reported later
    }
    slot->state.store(State::exposing, std::memory_order_relaxed);
    const Duration late_by = faults_.fires(InjectedFault::trigger_late).value_or(0ns);
    slot->trigger = request.exposure;
    slot->info = {.sequence = ++sequence_,
                  .exposure_start = std::max(request.start, loop_.now()) + late_by,
                  .bytes_used = slot->samples.size(),
                  .corrupt = false,
                  .exposure = faults_.names(InjectedFault::trigger_late) ? request.exposure : 0};
    slot->end = slot->info.exposure_start + request.length;
    slot->timer = loop_.call_at(slot->end, [this, number = number_of(*slot)] { exposed(number); });
    return {};
}

// The shutter closes: the frame holds the part that is in view now. Faults of the delivery do not change that.
void SimSensor::exposed(std::uint32_t number) {
    Slot& slot = slots_[number];
    const bool dark = faults_.fires(InjectedFault::frame_dark).has_value(),
               saturated = faults_.fires(InjectedFault::frame_saturated).has_value(),
               stale = faults_.fires(InjectedFault::frame_stale).has_value(),
               dropped = faults_.fires(InjectedFault::frame_drop).has_value(),
               cut_short = faults_.fires(InjectedFault::frame_short).has_value(),
               twice = faults_.fires(InjectedFault::frame_duplicate).has_value();
    const auto late_by = faults_.fires(InjectedFault::frame_late);
    const SimStrobe::Light light =
        dark ? SimStrobe::Light{} : strobe_.light_between(slot.info.exposure_start, slot.end);
    const TimePoint seen_at = light.amount > 0 ? light.at : slot.info.exposure_start;
    const World::InView view = world_.in_view(seen_at);
    Exposure exposure{.light = light.amount, .seed = random_bits(seed_, 0xF0A3, exposures_++)};
    if (saturated) exposure.light = 1e6;
    if (view.part != nullptr) {
        exposure.kind = view.part->kind;
        exposure.part = view.part->number;
        exposure.bad = view.part->bad;
        exposure.offset_mm = view.offset_mm;
        ++view.part->exposures;
    }
    slot.view = source_.expose(exposure, slot.samples);
    std::uint64_t part = light.amount > 0 ? exposure.part : 0;

    if (!last_samples_.empty()) {
        std::vector<std::byte> fresh(slot.view.data, slot.view.data + last_samples_.size());
        hal::FrameInfo info = slot.info;
        const std::uint64_t fresh_part = part;
        const std::uint32_t fresh_trigger = slot.trigger;
        if (stale) {  // before the first frame the old one is dark
            std::copy(last_samples_.begin(), last_samples_.end(), slot.samples.begin());
            slot.view.data = slot.samples.data();
            slot.info.exposure_start =
                last_info_.sequence == 0 ? slot.info.exposure_start - 1s : last_info_.exposure_start;
            slot.info.exposure = last_info_.exposure;
            slot.trigger = last_trigger_;
            part = last_part_;
        }
        last_samples_.swap(fresh);
        last_info_ = info;
        last_part_ = fresh_part;
        last_trigger_ = fresh_trigger;
    }
    seen_[slot.info.sequence % seen_.size()] = {slot.info.sequence, part, slot.trigger};

    slot.info.corrupt = faults_.fires(InjectedFault::frame_corrupt).has_value();
    if (dropped) {
        slot.state.store(State::free, std::memory_order_release);
        return;
    }
    if (cut_short) slot.info.bytes_used /= 2;
    const TimePoint due = slot.end + latency_.next() + late_by.value_or(0ns);
    deliver_later(slot, due);
    if (twice) duplicate(slot, due + 1us);
}

void SimSensor::deliver_later(Slot& slot, TimePoint due) {
    slot.state.store(State::reading, std::memory_order_relaxed);
    slot.timer = loop_.call_at(due, [this, number = number_of(slot)] { deliver(number); });
}

void SimSensor::duplicate(const Slot& slot, TimePoint due) {
    Slot* copy = take_free();
    if (copy == nullptr) return;
    copy->info = slot.info;
    copy->view = slot.view;
    if (slot.view.data == slot.samples.data()) {
        copy->samples = slot.samples;
        copy->view.data = copy->samples.data();
    }
    deliver_later(*copy, due);
}

void SimSensor::deliver(std::uint32_t number) {
    Slot& slot = slots_[number];
    slot.state.store(State::lent, std::memory_order_relaxed);
    listener_->on_frame(hal::FrameLease(*this, number, slot.view, slot.info));
}

void SimSensor::lose(Duration gone_for) {
    Listener* listener = listener_;
    do_stop();
    lost_ = true;
    back_at_ = loop_.now() + gone_for;
    lost_timer_ = loop_.call_after({}, [listener] {
        listener->on_sensor_lost({ErrorCode::disconnected, "simulated sensor is gone", "stop it and start it again"});
    });
}

void SimSensor::do_stop() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    for (int k = 0; k < options_.buffers; ++k) {
        Slot& slot = slots_[static_cast<std::size_t>(k)];
        const State state = slot.state.load(std::memory_order_acquire);
        if (state != State::exposing && state != State::reading) continue;
        loop_.cancel(slot.timer);
        slot.state.store(State::free, std::memory_order_release);
    }
}

}  // namespace hord::sim
