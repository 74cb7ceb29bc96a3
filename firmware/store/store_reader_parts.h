// What store_reader.cpp and verify.cpp share.
#pragma once

#include "firmware/store/database.h"
#include "firmware/store/store_reader.h"

namespace hord::firmware::store {

struct StoreReader::Parts {
    std::unique_ptr<Database> database;
    std::string id;
};

}  // namespace hord::firmware::store
