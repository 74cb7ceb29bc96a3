// HDF5 files of arrays. The library is not thread-safe: one thread at a time.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "common/result.h"
#include "firmware/exchange/array.h"

namespace hord::firmware {

using Attributes = std::vector<std::pair<std::string, std::string>>;  // name, text

struct Dataset {
    std::string path;  // "/maps/emd"; its groups are made
    Array array;
    Attributes attributes;
};

// Writes the datasets, and attributes of the whole file. The file is replaced atomically. Fails with internal, and as
// common::write_atomically() does.
Result<void> write_hdf5(const std::filesystem::path& file, const std::vector<Dataset>& datasets,
                        const Attributes& attributes);

// The dataset of this name in the file's root: unsigned integers of 8 or 16 bits. Fails with unreadable (no HDF5,
// damaged), not_found (no such dataset), unsupported (another type, more than common::kMaxFrameSamples elements).
Result<Array> read_hdf5(const std::filesystem::path& file, const std::string& dataset);

}  // namespace hord::firmware
