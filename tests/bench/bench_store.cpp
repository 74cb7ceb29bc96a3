// The store's throughput on this machine's memory and disk: results written in batches, listed, verified.
//
//     bench_store [RESULTS [FOLDER]]        200000 results, /dev/shm
#include <chrono>
#include <cstdlib>
#include <filesystem>

#include <fmt/format.h>
#include <unistd.h>

#include "firmware/store/results/sqlite_store.h"
#include "firmware/store/results/store_reader.h"

namespace {

using namespace hord;
using namespace hord::firmware;
namespace fs = std::filesystem;

constexpr std::uint32_t kBatch = 4096;  // StoreQueueOptions::batch

store::Entry entry(std::uint32_t number) {
    store::ResultRecord record;
    record.result.sequence = record.result.part = number;
    record.result.score = 0.4F;
    record.time_us = 1'790'000'000'000'000 + number * 100'000LL;
    if (number % 10 == 0) record.defects = {{12.25F, 3.5F, 9, 1.7F, algo::DefectKind::scratch}};
    return {number, record};
}

template <class Work>
double results_a_second(std::uint32_t count, const Work& work) {
    const auto begin = std::chrono::steady_clock::now();
    if (!work()) {
        fmt::print(stderr, "bench_store: the store cannot be used\n");
        std::exit(2);
    }
    return count / std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

int main(int argc, char** argv) {
    const auto count = static_cast<std::uint32_t>(argc > 1 ? std::atoi(argv[1]) : 200'000);
    const fs::path folder = fs::path(argc > 2 ? argv[2] : "/dev/shm") / fmt::format("bench-store-{}", getpid());
    const double written = results_a_second(count, [&] {
        auto opened = store::open_sqlite_store(folder);
        if (!opened) return false;
        std::vector<store::Entry> batch{
            {0, store::StartRecord{.time_us = 1, .boot = 7, .station = {}, .software = {}}}};
        for (std::uint32_t number = 1; number <= count; ++number) {
            batch.push_back(entry(number));
            if (batch.size() < kBatch && number != count) continue;
            if (!(*opened)->write(batch)) return false;
            batch.clear();
        }
        return true;
    });
    auto reader = store::StoreReader::open(folder);
    std::size_t bytes = 0;
    const double listed = results_a_second(count, [&] {
        return reader && (*reader)->each_result({}, [&](const store::StoredResult& r) { bytes += r.defects.size(); });
    });
    const double verified = results_a_second(count, [&] { return (*reader)->verify()->problems.empty(); });
    fs::remove_all(folder);
    fmt::print("results a second: written {:.0f}, listed {:.0f}, verified {:.0f} ({} bytes of defects)\n", written,
               listed, verified, bytes);
    return 0;
}
