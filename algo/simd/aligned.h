// Memory for vectors: no vector of up to 64 bytes whose place is a multiple of its size lies across two cache lines, or
// two pages. Where one does, it is read and written in two parts, on a page's edge many times slower; and malloc
// promises 16 bytes, so that it would be chance, another in every run.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace hord::algo {

inline constexpr std::size_t kAlignment = 64;

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
