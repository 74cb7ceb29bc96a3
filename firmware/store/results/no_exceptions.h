// No exception leaves a thread of the store.
#pragma once

#include <exception>
#include <string>

#include "common/result.h"

namespace hord::firmware::store {

// Runs `work`, which returns a Result. An exception (a library's, no memory) becomes an error: in a thread it would end
// the process, and with it the line.
template <class Work>
auto without_exceptions(const Work& work) -> decltype(work()) {
    try {
        return work();
    } catch (const std::exception& unexpected) {
        return fail(ErrorCode::internal, std::string("the store cannot be used (") + unexpected.what() + ")",
                    "report it");
    }
}

}  // namespace hord::firmware::store
