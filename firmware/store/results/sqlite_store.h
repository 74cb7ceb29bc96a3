// The store on a disk: one SQLite file in a folder, write-ahead log, every batch synced (PRAGMA synchronous = FULL).
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <system_error>

#include "common/file_writing.h"
#include "firmware/store/results/result_store.h"

namespace hord::firmware::store {

constexpr const char* kStoreFile = "results.db";

struct SqliteStoreOptions {
    std::string vfs = {};  // SQLite VFS, for tests; empty: the system's
    std::int64_t rows_in_one_prune = 20'000;
    // Set when a store finds its files moved or removed while they are open. Then only a file that was put back is
    // opened, and none is made. Share it between the openings of one run.
    std::shared_ptr<bool> moved = std::make_shared<bool>(false);
    // Called with what a person should know of a store that can be used all the same. May be empty.
    std::function<void(const Error&)> note = {};
    // Called when an operation has failed because the disk is full. May be empty.
    std::function<void()> disk_full = {};
    // Makes the folder unless it exists. Replaceable in tests.
    std::function<std::error_code(const std::filesystem::path&)> make_folder = common::ensure_folder;
};

// What to say when the store's folder cannot be made.
tl::unexpected<Error> folder_unusable(const std::filesystem::path& folder, std::error_code why);

// Fails with busy if another program writes the store in this folder. Other problems of the folder are no failure.
Result<void> check_not_written(const std::filesystem::path& folder);

// Creates the folder (not its parents) and the file if missing, migrates an older file, and locks the folder. Blocks.
// Fails with busy (another program writes this store), not_found (options.moved, and no file was put back), unsupported
// (written by newer software), unreadable (damaged), io (no permission, read-only, full disk, no such parent folder).
Result<std::unique_ptr<ResultStore>> open_sqlite_store(const std::filesystem::path& folder,
                                                       const SqliteStoreOptions& options = {});

}  // namespace hord::firmware::store
