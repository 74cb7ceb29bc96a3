// What a network does to the fake camera's stream, in the camera's process: so it needs no right and no kernel module.
// sendmsg() of this program stands before the C library's.
#pragma once

#include <chrono>
#include <cstddef>

namespace hord::test {

struct NetworkBetween {
    std::size_t mtu_bytes = 0;           // IP packets above this are dropped, as a switch drops them; 0: none
    std::chrono::milliseconds delay{0};  // of each packet
    std::size_t reorder_every = 0;       // each N-th packet comes after the three that follow it; 0: none
    // No network does that, but firmware: block ids go from 65535 to 0, and the first frame has 65533.
    bool block_zero = false;
};

// From now on, for all packets but those of the control channel. Once.
void put_between(const NetworkBetween& network);

// From now on `act` is called before each packet of the control channel, on the thread that sends it.
void before_each_answer(void (*act)());

}  // namespace hord::test
