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

// Where results come from: a store, or a bench's own.
class ResultSource {
  public:
    struct Where {
        std::string id;
        std::int64_t newest = 0;
    };
    virtual ~ResultSource() = default;
    // Opens what is not open yet, and notices when there is another store. Fails as StoreReader::open() does.
    Result<Where> look() { return do_look(); }
    // The first `count` with a higher number than `after`. Fails as StoreReader::each_result() does.
    Result<std::vector<store::StoredResult>> read(std::int64_t after, std::size_t count) {
        return do_read(after, count);
    }

  private:
    virtual Result<Where> do_look() = 0;
    virtual Result<std::vector<store::StoredResult>> do_read(std::int64_t after, std::size_t count) = 0;
};

class ResultFeed final : public ResultSource {
  public:
    explicit ResultFeed(std::filesystem::path folder) : folder_(std::move(folder)) {}

  private:
    Result<Where> do_look() override;
    Result<std::vector<store::StoredResult>> do_read(std::int64_t after, std::size_t count) override;

    const std::filesystem::path folder_;
    std::unique_ptr<store::StoreReader> reader_;
    std::uint64_t file_ = 0;  // inode that reader_ reads
};

}  // namespace hord::firmware::mqtt
