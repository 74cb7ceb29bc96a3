// The finished cells of an experiment's grid, kept in a file, so that an interrupted run continues where it was.
//
// The file holds one JSON object a line: first the parameters it was made with, then a cell a line, each written and
// flushed when it is finished. A last line that was cut off by an interrupt is dropped.
#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "common/result.h"

namespace hord::lab {

using Json = nlohmann::ordered_json;

class ResultCache {
  public:
    // Takes up `file`, or begins it. Fails with invalid_argument when it was made with other parameters or is not such
    // a file, with io when it cannot be read or written.
    static Result<ResultCache> open(const std::filesystem::path& file, const Json& parameters);

    // The cell's values; null while it is not finished.
    [[nodiscard]] const Json* find(const std::string& key) const;
    // Keeps a finished cell. Fails with io.
    Result<void> add(const std::string& key, Json values);

    // The cell's values, computed by `compute` (-> Result<Json>) unless they are kept already.
    template <class Compute>
    Result<Json> value(const std::string& key, const Compute& compute) {
        if (const Json* kept = find(key)) return *kept;
        Result<Json> computed = compute();
        if (!computed) return computed;
        if (auto done = add(key, *computed); !done) return tl::unexpected(done.error());
        return computed;
    }

    [[nodiscard]] std::size_t size() const { return cells_.size(); }
    [[nodiscard]] std::size_t taken_up() const { return taken_up_; }  // finished by an earlier run

  private:
    std::filesystem::path file_;
    std::map<std::string, Json> cells_;
    std::size_t taken_up_ = 0;
};

}  // namespace hord::lab
