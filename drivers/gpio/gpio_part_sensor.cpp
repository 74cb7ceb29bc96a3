#include "drivers/gpio/gpio_part_sensor.h"

#include <algorithm>
#include <utility>

namespace hord::drivers {

using hal::EventLoop;
using hal::PartEdge;

GpioPartSensor::GpioPartSensor(EventLoop& loop, const GpioPartSensorOptions& options, Lines lines)
    : loop_(loop), options_(options), lines_(std::move(lines)) {}
GpioPartSensor::~GpioPartSensor() { stop(); }

Result<std::unique_ptr<GpioPartSensor>> GpioPartSensor::open(EventLoop& loop, const GpioPartSensorOptions& options,
                                                             Lines lines) {
    std::unique_ptr<GpioPartSensor> sensor(new GpioPartSensor(loop, options, std::move(lines)));
    const auto part = sensor->lines_(options.line, GpioEdges::both);
    if (!part) return tl::unexpected(part.error());
    if (options.encoder) {
        const auto encoder = sensor->lines_(*options.encoder, GpioEdges::activations);
        if (!encoder) return tl::unexpected(encoder.error());
    }
    return sensor;
}

Result<void> GpioPartSensor::do_start(Listener& listener) {
    auto part = lines_(options_.line, GpioEdges::both);
    if (!part) return tl::unexpected(part.error());
    std::unique_ptr<GpioInput> encoder;
    if (options_.encoder) {
        auto taken = lines_(*options_.encoder, GpioEdges::activations);
        if (!taken) return tl::unexpected(taken.error());
        encoder = std::move(*taken);
    }
    // The initial level, with no edge queued that this level already includes.
    Result<bool> level = false;
    do {
        raw_.clear();
        level = (*part)->active();
        if (!level) return tl::unexpected(level.error());
        if (auto read = (*part)->read(raw_); !read) return read;
    } while (!raw_.empty());

    auto watch = loop_.watch((*part)->fd(), EventLoop::Readiness::readable, [this] { on_ready(); });
    if (!watch) return tl::unexpected(watch.error());
    part_watch_ = *watch;
    if (encoder) {
        watch = loop_.watch(encoder->fd(), EventLoop::Readiness::readable, [this] { read_counts(); });
        if (!watch) {
            loop_.unwatch(part_watch_);
            return tl::unexpected(watch.error());
        }
        encoder_watch_ = *watch;
        track_.emplace();
    }
    part_ = std::move(*part);
    encoder_ = std::move(encoder);
    filter_.emplace(options_.debounce, std::max(kMaxBurst, 20 * options_.debounce), *level);
    listener_ = &listener;
    ++starts_;
    check_timer_ = loop_.call_after(kCheckEvery, [this] { check_line(); });
    if (encoder_) position_timer_ = loop_.call_after(options_.encoder_every, [this] { report_position(); });
    return {};
}

void GpioPartSensor::on_ready() {
    if (read_edges()) (void)settle_when_due();
}

// Feeds the queued raw edges to the filter and reports the confirmed edges.
bool GpioPartSensor::read_edges() {
    raw_.clear();
    if (const auto read = part_->read(raw_); !read) {
        lose(read.error());
        return false;
    }
    for (const GpioEdge& edge : raw_) filter_->feed(edge, edges_);
    if (filter_->bouncing_too_long()) {
        lose({ErrorCode::io, gpio::name_of(options_.line) + " does not come to rest",
              "check the part sensor's wiring, alignment and shield"});
        return false;
    }
    if (edges_.empty()) return true;
    read_counts();  // so that the position at each edge is known
    if (!part_) return false;
    const std::uint32_t this_start = starts_;
    for (const EdgeFilter::Edge& edge : std::exchange(edges_, {})) {
        PartEdge part_edge{edge.active ? PartEdge::Kind::arrives : PartEdge::Kind::leaves, edge.at, edge.sequence, {}};
        if (track_) {
            part_edge.counts = track_->counts_at(edge.at);
            if (!part_edge.counts) {
                lose({ErrorCode::io, "the encoder's position at an edge of the part sensor is not known any more",
                      "shorten part_sensor.debounce_us, or use an encoder with fewer counts"});
                return false;
            }
        }
        listener_->on_edge(part_edge);
        if (listener_ == nullptr || starts_ != this_start)
            return false;  // the listener stopped the sensor, and may have started it again
    }
    return true;
}

// Reads the level first and the queued edges after it: an edge in between postpones the decision.
bool GpioPartSensor::settle_when_due() {
    loop_.cancel(settle_timer_);
    if (filter_->due() && *filter_->due() <= loop_.now()) {
        const auto level = part_->active();
        if (!level) {
            lose(level.error());
            return false;
        }
        if (!read_edges()) return false;
        if (raw_.empty()) filter_->settle(loop_.now(), *level, edges_);
        if (!read_edges()) return false;  // reports the edge
    }
    if (const auto due = filter_->due()) settle_timer_ = loop_.call_at(*due, [this] { (void)settle_when_due(); });
    return true;
}

// Finds a chip that went away, and a level that changed without an edge.
void GpioPartSensor::check_line() {
    const auto level = part_->active();
    if (!level) return lose(level.error());
    if (encoder_) {
        if (const auto encoder_level = encoder_->active(); !encoder_level) return lose(encoder_level.error());
    }
    if (!read_edges()) return;
    if (raw_.empty() && !filter_->due()) {
        filter_->settle(loop_.now(), *level, edges_);
        if (!read_edges()) return;
    }
    if (!settle_when_due()) return;
    check_timer_ = loop_.call_after(kCheckEvery, [this] { check_line(); });
}

void GpioPartSensor::read_counts() {
    if (!encoder_) return;
    std::vector<GpioEdge> counts;
    if (const auto read = encoder_->read(counts); !read) return lose(read.error());
    for (const GpioEdge& edge : counts) {
        if (edge.lost > 0) {
            return lose(
                {ErrorCode::io,
                 gpio::name_of(*options_.encoder) + " turns faster than its edges can be taken: counts were lost",
                 "use an encoder with fewer counts, or track by time"});
        }
        track_->count(edge.at);
    }
}

void GpioPartSensor::report_position() {
    read_counts();
    if (!part_) return;  // lost
    position_timer_ = loop_.call_after(options_.encoder_every, [this] { report_position(); });
    listener_->on_encoder({loop_.now(), track_->counts()});
}

void GpioPartSensor::lose(const Error& why) {
    if (!part_) return;
    release();
    lost_timer_ = loop_.call_after({}, [this, why] { listener_->on_part_sensor_lost(why); });
}

void GpioPartSensor::release() {
    if (!part_) return;
    loop_.unwatch(part_watch_);
    if (encoder_) loop_.unwatch(encoder_watch_);
    for (const auto timer : {check_timer_, settle_timer_, position_timer_}) loop_.cancel(timer);
    part_.reset();
    encoder_.reset();
    track_.reset();
    edges_.clear();
}

void GpioPartSensor::do_stop() {
    release();
    loop_.cancel(lost_timer_);
    listener_ = nullptr;
}

}  // namespace hord::drivers
