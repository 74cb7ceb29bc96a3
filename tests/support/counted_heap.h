// Counts every use of the heap by the program that links tests/support/counted_heap.cpp, by whatever thread.
#pragma once

#include <atomic>
#include <cstdint>

namespace hord::test {

extern std::atomic<std::uint64_t> allocations;

// What `work` allocates.
template <class Work>
std::uint64_t allocated_by(Work work) {
    const std::uint64_t before = allocations;
    work();
    return allocations - before;
}

}  // namespace hord::test
