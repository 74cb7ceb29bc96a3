// The finished cells of an experiment's grid in a file, so that an interrupted run can continue.
//
// The file holds one JSON object a line: the parameters of the run, then one finished cell a line, flushed at once. An
// incomplete last line is dropped.
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
    // Continues `file`, or creates it. Fails with invalid_argument when it has other parameters or is not such a file,
    // with io when it cannot be read or written.
    static Result<ResultCache> open(const std::filesystem::path& file, const Json& parameters);

    // The cell's values; null if it is not finished.
    [[nodiscard]] const Json* find(const std::string& key) const;
    // Appends a finished cell. Fails with io.
    Result<void> add(const std::string& key, Json values);

    // The cell's values; `compute` (-> Result<Json>) is called if it is not finished.
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
