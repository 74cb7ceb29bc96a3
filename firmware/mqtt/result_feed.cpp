#include "firmware/mqtt/result_feed.h"

#include <sys/stat.h>

#include "firmware/store/results/sqlite_store.h"

namespace hord::firmware::mqtt {

Result<ResultSource::Where> ResultFeed::look() {
    // The station may have replaced a damaged file: without reopening, the old one would be read forever.
    struct stat now {};
    const bool there = ::stat((folder_ / store::kStoreFile).c_str(), &now) == 0;
    if (!there || static_cast<std::uint64_t>(now.st_ino) != file_) reader_.reset();
    if (!reader_) {
        auto opened = store::StoreReader::open(folder_);
        std::error_code error;
        if (!opened && opened.error().code == ErrorCode::io &&
            !std::filesystem::exists((folder_ / store::kStoreFile).string() + "-wal", error)) {
            // SQLite needs the files beside it, which the station removed when it stopped, and which a reader may not
            // make.
            return fail(ErrorCode::busy,
                        (folder_ / store::kStoreFile).string() +
                            " was closed by its station, and cannot be read until it runs again",
                        "start the station");
        }
        if (!opened) return tl::unexpected(opened.error());
        reader_ = std::move(*opened);
        file_ = static_cast<std::uint64_t>(now.st_ino);
    }
    const auto newest = reader_->newest_number();
    if (!newest) {
        reader_.reset();
        return tl::unexpected(newest.error());
    }
    return Where{reader_->id(), *newest};
}

Result<std::vector<store::StoredResult>> ResultFeed::read(std::int64_t after, std::size_t count) {
    std::vector<store::StoredResult> results;
    if (!reader_) return results;
    store::ResultFilter filter;
    filter.after = after;
    filter.oldest = static_cast<std::int64_t>(count);
    const auto done =
        reader_->each_result(filter, [&](const store::StoredResult& result) { results.push_back(result); });
    if (!done) {
        reader_.reset();
        return tl::unexpected(done.error());
    }
    return results;
}

}  // namespace hord::firmware::mqtt
