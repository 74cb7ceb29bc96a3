// References in Python.
#pragma once

#include "algo/reference/reference.h"
#include "lab/python/module.h"

namespace hord::lab::python {

struct ReferenceHandle {
    std::shared_ptr<const algo::Reference> reference;
};

// `reference`: a Reference, or its file.
std::shared_ptr<const algo::Reference> reference_of(const py::object& reference);

}  // namespace hord::lab::python
