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
        decided,    // to be rejected, its command is not due yet
        commanded,  // the ejector was told, its report is awaited
        complete,   // recorded; only its way past the ejector remains
    };
    Phase phase = Phase::waiting;
    bool wanted = false;     // came while executing: is (or was) to be inspected
    bool exposed = false;    // sensor and strobe were told; exposure_start holds
    bool frame_due = false;  // triggered, no frame matched yet
    bool light_due = false;  // fired, no strobe report yet
    bool light_good = false;
    bool place_good = false;  // it was before the camera at its exposure (without encoder: taken for granted)
    bool inspecting = false;  // its frame is with the inspector
    bool judged = false;
    bool command_late = false;             // the part was at the ejector before its command
    bool place_lost = false;               // the line may have stopped on its way to the ejector, unobserved
    bool abandoned = false;                // and a reset has ended its story
    bool reported = false;                 // the rejector's report has come
    PartReason oddity = PartReason::none;  // a frame that came instead of this part's own

    TimePoint arrived;
    std::int64_t edge_counts = 0;    // with encoder: where the conveyor was
    std::int64_t target_counts = 0;  // and where it is when the part is at the ejector
    TimePoint exposure_start;
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
