// The parts between the part sensor and the ejector, oldest first, in memory of fixed size.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/core/core_config.h"
#include "firmware/core/events.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

struct Part {
    enum class Phase : std::uint8_t {
        waiting,    // no verdict yet
        decided,    // to be rejected; its command is not due yet
        commanded,  // the rejector has the command; its report is awaited
        complete,   // recorded; it has not passed the ejector yet
    };
    Phase phase = Phase::waiting;
    bool accepted = false;   // came while the station accepted parts: to be inspected
    bool exposed = false;    // exposure and light were requested; exposure_start is set
    bool frame_due = false;  // requested, no frame matched yet
    bool light_due = false;  // requested, no strobe report yet
    bool light_good = false;
    bool place_good = false;  // it was in front of the camera at its exposure (without encoder: assumed)
    bool inspecting = false;  // its frame is with the inspector
    bool judged = false;
    bool command_late = false;  // the part reached the ejector before its command
    bool place_lost = false;    // without encoder: it came, or was on its way, while the line had no run permit
    bool abandoned = false;     // place_lost, and a reset has ended its tracking
    bool reported = false;      // the rejector's report has come
    PartReason stray_frame = PartReason::none;  // that came meanwhile: the reason if its own frame never comes

    TimePoint arrived;
    std::int64_t edge_counts = 0;    // with encoder: at the edge
    std::int64_t target_counts = 0;  // with encoder: when the part is at the ejector
    TimePoint exposure_start;
    TimePoint asked_at;  // when exposure and light were requested
    Judged judgement;

    TimePoint eject_start;                        // of the commanded pulse
    TimePoint passed_ejector = TimePoint::max();  // with encoder: when it crossed
    hal::RejectReport report;
    PartResult result;

    [[nodiscard]] std::uint32_t number() const { return result.part; }
};

class Line {
  public:
    [[nodiscard]] std::uint32_t size() const { return size_; }
    [[nodiscard]] bool full() const { return size_ == kLineCapacity; }
    [[nodiscard]] Part& operator[](std::uint32_t k) { return parts_[(head_ + k) % kLineCapacity]; }
    [[nodiscard]] const Part& operator[](std::uint32_t k) const { return parts_[(head_ + k) % kLineCapacity]; }

    Part& append() {
        Part& part = (*this)[size_++];
        part = Part{};
        return part;
    }
    void pop_oldest() {
        head_ = (head_ + 1) % kLineCapacity;
        --size_;
    }
    [[nodiscard]] Part* find(std::uint32_t number) {
        for (std::uint32_t k = size_; k-- > 0;) {
            if ((*this)[k].number() == number) return &(*this)[k];
        }
        return nullptr;
    }

  private:
    std::array<Part, kLineCapacity> parts_{};
    std::uint32_t head_ = 0;
    std::uint32_t size_ = 0;
};

}  // namespace hord::firmware
