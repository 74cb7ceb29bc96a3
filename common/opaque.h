// A struct that only its .cpp file defines. Its owner holds an Opaque and needs no destructor and no moves of its own.
#pragma once

#include <memory>
#include <utility>

namespace hord::common {

template <class T>
using Opaque = std::unique_ptr<T, void (*)(T*)>;

template <class T, class... Arguments>
Opaque<T> make_opaque(Arguments&&... arguments) {
    return {new T(std::forward<Arguments>(arguments)...), [](T* it) { delete it; }};
}

}  // namespace hord::common
