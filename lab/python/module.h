// The parts of the Python module `hord`, and what they share.
//
// A call that computes releases the GIL; objects that must not be used by two threads at once hold a mutex. An Error
// becomes a Python exception (hord/errors.py) with the same sentence.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::lab::python {

namespace py = pybind11;

// An Error on its way to Python.
struct Failure {
    Error error;
};

template <class T>
T unwrap(Result<T>&& result) {
    if (!result) throw Failure{std::move(result.error())};
    if constexpr (!std::is_void_v<T>) return std::move(*result);
}

[[noreturn]] void refuse(std::string what, std::string cure);

// Calls `work` without the GIL and returns its result.
template <class Work>
decltype(auto) without_gil(Work&& work) {
    const py::gil_scoped_release released;
    return std::forward<Work>(work)();
}

// -- arrays (arrays.cpp)

// Whether it is a str, bytes or a path-like object.
bool may_be_path(const py::handle& given);
// The path that it is. Refuses an empty one and NUL characters. A TypeError says what may be given instead (`wanted`):
// "a recipe is a Recipe or the path of its file, not int".
std::filesystem::path path_of(const py::object& given, const char* wanted);

// The path of an argument that takes nothing else.
struct File : std::filesystem::path {};

// A copy of one value a lenslet, [n, m].
template <class T>
py::array_t<T> lenslet_array(std::span<const T> values, const algo::Extents& extents) {
    py::array_t<T> out({extents.n, extents.m});
    std::copy(values.begin(), values.end(), out.mutable_data());
    return out;
}

// Makes the array read-only and returns it.
py::array read_only(py::array array);

// A grey frame in Python's memory: shape (height, width), uint8 or uint16.
struct ArrayFrame {
    py::array array;  // keeps the memory
    FrameView view;
};

// The array as a frame, without a copy where the samples of a row are neighbours. `bits`: 0 for those of the type.
// Refuses arrays of another type or number of dimensions, and bits that the type does not have.
ArrayFrame frame_of(const py::array& array, int bits);
// The frame's memory becomes an array.
ArrayFrame frame_of(Frame&& frame);
// Refuses samples above the full scale: an array may have been written to since. Without the GIL.
void check_samples(const FrameView& view);

// Bins a lenslet from "9x9" or (9, 9).
std::pair<int, int> bins_of(const py::object& bins);

// -- the parts of the module; each adds its classes and functions

void add_light_field(py::module_& module);
void add_features(py::module_& module);
void add_inspection(py::module_& module);
void add_reference(py::module_& module);
void add_calibration(py::module_& module);

}  // namespace hord::lab::python

namespace pybind11::detail {

template <>
struct type_caster<hord::lab::python::File> {
    PYBIND11_TYPE_CASTER(hord::lab::python::File, const_name("os.PathLike"));

    bool load(handle given, bool) {
        if (!hord::lab::python::may_be_path(given)) return false;  // hord/plain.py says what the argument takes
        value = {hord::lab::python::path_of(reinterpret_borrow<object>(given), "file is the path of a file")};
        return true;
    }
};

}  // namespace pybind11::detail
