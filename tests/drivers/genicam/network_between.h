// What a network does to the fake camera's stream, in the camera's process: so it needs no right and no kernel module.
// sendmsg() and recvmsg() of this program are called instead of the C library's.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace hord::test {

struct NetworkBetween {
    std::size_t mtu_bytes = 0;           // IP packets above this are dropped, as a switch drops them; 0: none
    std::chrono::milliseconds delay{0};  // of each packet
    std::size_t reorder_every = 0;       // each N-th packet comes after the three that follow it; 0: none
    // Each N-th packet of a frame is lost, and comes when it is asked for again (PACKETRESEND_CMD of the control
    // channel). 0: none.
    unsigned lose_every = 0;
    unsigned never = 0;  // this packet of each third frame is lost whenever it is sent; 0: none
    // No network does that, but firmware: block ids go from 65535 to 0, and the first frame has 65533.
    bool block_zero = false;
    // Nor that: this 32-bit word of the first packet of each frame is `leader_value`. 0: none.
    std::size_t leader_at = 0;
    std::uint32_t leader_value = 0;
};

// From now on, for all packets but those of the control channel. Once.
void put_between(const NetworkBetween& network);

// The next `count` answers to questions that the station asks past Aravis (by their request id) are lost.
void lose_answers(unsigned count);

// From now on `act` is called before each packet of the control channel, on the thread that sends it.
void before_each_answer(void (*act)());

}  // namespace hord::test
