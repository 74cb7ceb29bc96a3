// Results of a store in the order of their numbers, while a station writes it. Reads only; one thread.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/store/results/store_reader.h"

namespace hord::firmware::mqtt {

// A source of results: a store, or a test's own.
class ResultSource {
  public:
    struct Where {
        std::string id;
        std::int64_t newest = 0;
    };
    virtual ~ResultSource() = default;
    // Opens the store if necessary, and again if it was replaced. Fails as StoreReader::open().
    virtual Result<Where> look() = 0;
    // The first `count` results with numbers above `after`. Fails as StoreReader::each_result().
    virtual Result<std::vector<store::StoredResult>> read(std::int64_t after, std::size_t count) = 0;
};

class ResultFeed final : public ResultSource {
  public:
    explicit ResultFeed(std::filesystem::path folder) : folder_(std::move(folder)) {}
    Result<Where> look() override;
    Result<std::vector<store::StoredResult>> read(std::int64_t after, std::size_t count) override;

  private:
    const std::filesystem::path folder_;
    std::unique_ptr<store::StoreReader> reader_;
    std::uint64_t file_ = 0;  // inode that reader_ reads
};

}  // namespace hord::firmware::mqtt
