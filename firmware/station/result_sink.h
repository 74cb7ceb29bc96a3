// Interface of the recorder: it stores results, acknowledgements by the PLC, and changes with who made them.
//
// Without a recorder nothing is stored. Called on the loop's thread unless noted otherwise. Must not block: slow work
// belongs on a thread of the recorder.
#pragma once

#include <cstdint>
#include <string>

#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Origin of a request: peer address and command token. Both empty: the station itself.
struct RequestOrigin {
    std::string peer;  // "192.0.2.7:50123", a serial line's device
    std::uint32_t token = 0;
};

struct Change {
    enum class What : std::uint8_t { recipe, configuration, command };
    What what = What::command;
    RequestOrigin who;
    std::string name;           // of the recipe, the key or the command
    std::string before, after;  // a recipe: the text of its file; a command: the state before, and its outcome
};

class ResultSink {
  public:
    virtual ~ResultSink() = default;

    // Every result once, in order, before a PLC can read it.
    virtual void on_result(const PartResult& result) = 0;

    // A PLC acknowledges the results up to `sequence`. Unless `recorded`, nothing has changed.
    virtual AckStatus on_acknowledged(const RequestOrigin& who, std::uint32_t sequence) = 0;

    // After the change or command, also after a failed one.
    virtual void on_change(const Change& change) = 0;

    // On the inspecting threads, concurrently; references are valid during the call only.
    virtual void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) = 0;
};

}  // namespace hord::firmware
