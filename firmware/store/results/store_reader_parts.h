// What store_reader.cpp and verify.cpp share.
#pragma once

#include "firmware/store/results/database.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::store {

struct StoreReader::Parts {
    std::unique_ptr<Database> database;
    std::string id;
};

}  // namespace hord::firmware::store
