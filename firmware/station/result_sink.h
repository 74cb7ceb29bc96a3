// Who keeps what outlives a run: results, what the PLC has taken, and who changed what.
//
// The service tells it everything here; nothing is kept without one. Called on the loop's thread unless said otherwise;
// must not block it: what takes long belongs on a thread of the recorder's own.
#pragma once

#include <cstdint>
#include <string>

#include "algo/inspection/pipeline.h"
#include "common/frame.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Who asked for something: the address it came from and the token of its command. Both empty: the station itself.
struct Who {
    std::string peer;  // "192.0.2.7:50123", a serial line's device
    std::uint32_t token = 0;
};

struct Change {
    enum class What : std::uint8_t { recipe, configuration, command };
    What what = What::command;
    Who who;
    std::string name;           // of the recipe, the key or the command
    std::string before, after;  // a recipe: the text of its file; a command: the state, and what it came to
};

// Whether a PLC may count results as taken: only when they would outlive a loss of power.
enum class Taken : std::uint8_t {
    yes,
    not_yet,  // in a moment: it is to ask again
    cannot,   // they cannot be stored now
};

class ResultSink {
  public:
    virtual ~ResultSink() = default;

    // Every result once, in order, before a PLC can read it.
    virtual void on_result(const PartResult& result) = 0;

    // A PLC wants to take the results up to `sequence`. `yes`: they are the PLC's now; else nothing has happened.
    virtual Taken on_acknowledged(const Who& who, std::uint32_t sequence) = 0;

    // After it has happened, whatever came of it.
    virtual void on_change(const Change& change) = 0;

    // On the thread that inspects (with several: on each, at the same time); what is borrowed is valid during the call
    // only.
    virtual void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) = 0;
};

}  // namespace hord::firmware
