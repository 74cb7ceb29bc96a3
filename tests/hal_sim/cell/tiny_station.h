// A minimal station: lights and photographs every part in front of the camera, and rejects it if its frame's token is
// bad. It has no checks; for tests of the cell, not of the station.
#pragma once

#include <optional>
#include <vector>

#include "hal_sim/cell/cell.h"

namespace hord::sim {

class TinyStation final : hal::PartSensor::Listener,
                          hal::Strobe::Listener,
                          hal::Sensor::Listener,
                          hal::Rejector::Listener {
  public:
    struct Seen {
        hal::FrameInfo info;
        std::optional<TokenFrames::Token> token;
    };

    TinyStation(SimulatedCell& cell, const CellOptions& options) : cell_(cell), options_(options) {
        (void)cell.rejector().start(*this);
        (void)cell.part_sensor().start(*this);
        (void)cell.strobe().start(*this);
        (void)cell.sensor().start(*this);
    }
    ~TinyStation() {
        cell_.part_sensor().stop();
        cell_.sensor().stop();
        cell_.strobe().stop();
        cell_.rejector().stop();
    }

    std::vector<hal::PartEdge> edges;
    std::vector<hal::EncoderReading> readings;
    std::vector<hal::StrobeReport> strobes;
    std::vector<Seen> frames;
    std::vector<hal::RejectReport> rejects;
    int losses = 0, link_changes = 0;

  private:
    static constexpr hal::Duration kPulse = std::chrono::microseconds(50);

    void on_edge(const hal::PartEdge& edge) override {
        edges.push_back(edge);
        if (edge.kind != hal::PartEdge::Kind::arrives) return;
        arrivals_.push_back(edge.at);
        const auto exposure = static_cast<std::uint32_t>(arrivals_.size());
        const hal::TimePoint at = edge.at + options_.camera_delay();
        (void)cell_.sensor().trigger({exposure, at - 2 * kPulse, 8 * kPulse});
        (void)cell_.strobe().fire({exposure, 1, at, kPulse});
    }
    void on_encoder(const hal::EncoderReading& reading) override { readings.push_back(reading); }
    void on_part_sensor_lost(const Error&) override { ++losses; }
    void on_strobe(const hal::StrobeReport& report) override { strobes.push_back(report); }
    void on_strobe_lost(const Error&) override { ++losses; }
    void on_frame(hal::FrameLease frame) override {
        frames.push_back({frame.info(), TokenFrames::read(frame.view())});
        const auto& token = frames.back().token;
        if (!token || !token->bad || frame.info().sequence > arrivals_.size()) return;
        const hal::TimePoint arrived = arrivals_[frame.info().sequence - 1];
        (void)cell_.rejector().reject({frame.info().sequence,
                                       arrived + options_.ejector_delay() - std::chrono::milliseconds(5),
                                       std::chrono::milliseconds(10)});
    }
    void on_sensor_lost(const Error&) override { ++losses; }
    void on_reject(const hal::RejectReport& report) override { rejects.push_back(report); }
    void on_rejector_link(bool, const Error&) override { ++link_changes; }

    SimulatedCell& cell_;
    CellOptions options_;
    std::vector<hal::TimePoint> arrivals_;
};

}  // namespace hord::sim
