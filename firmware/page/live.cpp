#include "firmware/page/live.h"

#include <algorithm>

#include <fmt/format.h>

#include "firmware/core/enum_values.h"
#include "firmware/core/faults.h"
#include "firmware/core/states.h"
#include "firmware/page/commands.h"
#include "firmware/page/page_config.h"

namespace hord::firmware::page {
namespace {

using store::Json;
using store::to_text;

Json faults_of(std::uint32_t bits) {
    Json list = Json::array();
    for (const FaultInfo& fault : kFaultTable) {
        if ((bits & fault.bit) != 0)
            list.push_back({{"name", fault.name}, {"meaning", fault.meaning}, {"cure", fault.cure}});
    }
    return list;
}

// All rows of all blocks: numbers, or the names of named values.
Json rows_of(const RegisterSnapshot& snapshot) {
    Json json = Json::object();
    for (const auto& [id, readings] : snapshot.blocks()) {
        Json block = Json::object();
        for (const Reading& r : readings) {
            const std::string name(r.what->name);
            const bool named = r.what->type == RegisterType::u16 && !r.what->values.empty();
            if (r.what->type == RegisterType::text || (named && r.number))
                block[name] = RegisterSnapshot::plain_text(r);
            else if (r.number && r.what->scale == 1) block[name] = static_cast<std::int64_t>(*r.number);
            else if (r.number) block[name] = *r.number;
            else block[name] = nullptr;
        }
        json[lower(find_block(id)->name)] = std::move(block);
    }
    return json;
}

// The names of the commands of the page that the state allows. While a device is down the station refuses to be armed.
Json commands_of(State state, bool device_down) {
    Json list = Json::array();
    for (const Command command : kValuesOf<Command>) {
        if (command == Command::arm && device_down) continue;
        if (page_offers(command) && is_possible(state, command)) list.push_back(name_of(command));
    }
    return list;
}

std::optional<float> in_ms(std::optional<double> us) {
    return us ? std::optional<float>(static_cast<float>(*us / 1e3)) : std::nullopt;
}
}  // namespace

void LatencyHistogram::add(double seconds) {
    const auto at = std::lower_bound(kBounds_s.begin(), kBounds_s.end(), seconds);
    ++counts[static_cast<std::size_t>(at - kBounds_s.begin())];
    sum_s += seconds;
}

std::string RingResult::key() const { return fmt::format("{:08x}-{}", boot, part); }

Json RingResult::json() const {
    Json json{{"key", key()},     {"sequence", sequence}, {"part", part},       {"verdict", verdict},
              {"reason", reason}, {"reject", reject},     {"defects", defects}, {"verdict_ms", verdict_ms}};
    json["score"] = score ? Json(*score) : Json();
    if (bounded) json["bounded"] = true;
    json["latency_us"] = latency_us ? Json(*latency_us) : Json();
    json["reject_latency_us"] = reject_latency_us ? Json(*reject_latency_us) : Json();
    return json;
}

void Live::set_station(const RegisterSnapshot& snapshot) {
    const std::lock_guard lock(mutex_);
    now_.up = true;
    now_.snapshot = snapshot;
    viewers_.publish("state", to_text(state_locked()));
}

void Live::add_result(const RingResult& result) {
    const std::lock_guard lock(mutex_);
    strip_.push_back(result);
    if (strip_.size() > kStrip) strip_.pop_front();
    if (result.latency_us) now_.verdict.add(*result.latency_us / 1e6);
    if (result.reject == "confirmed" && result.reject_latency_us) now_.reject.add(*result.reject_latency_us / 1e6);
    ++now_.by_reason[result.reason];
    viewers_.publish("result", to_text(result.json()));
}

void Live::add_missed(std::uint32_t results) {
    const std::lock_guard lock(mutex_);
    now_.missed += results;
}

void Live::set_unreachable(const Error& error) {
    const std::lock_guard lock(mutex_);
    const bool news = now_.up || error.what != trouble_.what;
    now_.up = false;
    trouble_ = error;
    if (news) viewers_.publish("state", to_text(state_locked()));
}

void Live::set_picture(std::uint32_t boot, std::uint32_t part, std::int64_t verdict_ms) {
    const std::lock_guard lock(mutex_);
    picture_ = {{"key", fmt::format("{:08x}-{}", boot, part)}, {"part", part}, {"verdict_ms", verdict_ms}};
    viewers_.publish("picture", to_text(picture_));
}

void Live::set_light(double share) {
    const std::lock_guard lock(mutex_);
    now_.light = share;
}

void Live::sample(std::int64_t now_s) {
    const std::lock_guard lock(mutex_);
    HistoryValues v;
    if (now_.up) {
        const auto health = [&](std::string_view row) { return now_.snapshot.number(BlockId::health, row); };
        const auto count = [&](std::string_view row) {
            return now_.snapshot.number(BlockId::counters, row).value_or(0);
        };
        const Counted now{now_.snapshot.bits(BlockId::ident, "boot_id"), count("pass"), count("reject"),
                          count("unfit")};
        v[0] = health("parts_per_minute");
        if (counted_ && counted_->boot == now.boot) {
            const double per_minute = 60.0 / History::kShortStep_s;
            v[1] = (now.pass - counted_->pass) * per_minute;
            v[2] = (now.reject - counted_->reject) * per_minute;
            v[3] = (now.unfit - counted_->unfit) * per_minute;
        }
        counted_ = now;
        v[4] = in_ms(health("latency_p50"));
        v[5] = in_ms(health("latency_p99"));
        v[6] = in_ms(health("reject_p99"));
        v[7] = now_.snapshot.number(BlockId::calibration, "drift");
        v[8] = now_.snapshot.number(BlockId::calibration, "residual");
        if (now_.light) v[9] = static_cast<float>(100 * *now_.light);
        v[10] = health("processor");
        v[11] = health("disk_free");
    } else {
        counted_.reset();
    }
    history_.add(now_s, v);
}

Json Live::state_locked() const {
    Json json{{"up", now_.up}};
    if (!now_.up) json["trouble"] = {{"what", trouble_.what}, {"cure", trouble_.cure}};
    const std::uint32_t active = now_.up ? now_.snapshot.bits(BlockId::status, "faults_active") : 0,
                        latched = now_.up ? now_.snapshot.bits(BlockId::status, "faults_latched") : 0;
    for (const char* bit : {"line_stop", "run_permit", "plc_lost", "results_overrun"})
        json[bit] = now_.up ? Json(now_.snapshot.status_bit(bit)) : Json();  // null: not known
    const std::uint32_t simulated = now_.up ? now_.snapshot.bits(BlockId::status, "simulated") : 0;
    json["simulated"] = simulated != 0 ? names_of_faults(simulated) : "";
    json["faults_active"] = faults_of(active);
    json["faults_latched"] = faults_of(latched & ~active);
    // What a person may command now, and what the station waits for before it can be armed.
    json["commands"] = Json::array();
    json["next"] = json["possible"] = Json();
    if (const auto state = now_.up ? now_.snapshot.number(BlockId::status, "state") : std::nullopt) {
        const auto now = static_cast<State>(static_cast<std::uint16_t>(*state));
        json["commands"] = commands_of(now, (active & kDeviceFaults) != 0);
        if (const auto next = next_command(now)) json["next"] = name_of(*next);
        json["possible"] = possible_commands_text(now, page_offers);
    }
    json["devices_down"] = (active & kDeviceFaults) != 0 ? names_of_faults(active & kDeviceFaults) : "";
    json["light_share"] = now_.light ? Json(*now_.light) : Json();
    json["rows"] = rows_of(now_.snapshot);
    return json;
}

Json Live::state_json() const {
    const std::lock_guard lock(mutex_);
    return state_locked();
}

Json Live::page_json() const {
    const std::lock_guard lock(mutex_);
    Json results = Json::array();
    for (const RingResult& result : strip_) results.push_back(result.json());
    return {{"state", state_locked()}, {"results", std::move(results)}, {"picture", picture_}};
}

std::string Live::history_json(bool long_steps) const {
    const std::lock_guard lock(mutex_);
    return history_.json(long_steps);
}

Live::Figures Live::figures() const {
    const std::lock_guard lock(mutex_);
    return now_;
}

}  // namespace hord::firmware::page
