// Containers aligned to a cache line: a vector load or store of up to 64 bytes then never crosses a cache line or a
// page, which would cost many times a normal access. malloc only guarantees 16 bytes.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace hord::algo {

inline constexpr std::size_t kAlignment = 64;  // bytes

template <class T>
struct AlignedAllocator {
    using value_type = T;
    AlignedAllocator() = default;
    template <class Other>
    AlignedAllocator(const AlignedAllocator<Other>& /*same*/) {}

    T* allocate(std::size_t count) {
        return static_cast<T*>(::operator new (count * sizeof(T), std::align_val_t{kAlignment}));
    }
    void deallocate(T* from, std::size_t /*count*/) noexcept { ::operator delete (from, std::align_val_t{kAlignment}); }
    bool operator==(const AlignedAllocator& /*other*/) const = default;
};

template <class T>
using AlignedVector = std::vector<T, AlignedAllocator<T>>;

}  // namespace hord::algo
