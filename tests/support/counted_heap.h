// Counts every heap allocation, of any thread, in a program that links tests/support/counted_heap.cpp.
#pragma once

#include <atomic>
#include <cstdint>

namespace hord::test {

extern std::atomic<std::uint64_t> allocations;

// The number of allocations during `work`.
template <class Work>
std::uint64_t allocated_by(Work work) {
    const std::uint64_t before = allocations;
    work();
    return allocations - before;
}

}  // namespace hord::test
