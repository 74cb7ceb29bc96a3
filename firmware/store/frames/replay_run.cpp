#include "firmware/store/frames/replay_run.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "common/crc32.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::store {

bool Shard::holds(const ArchivedFile& frame) const {
    const std::uint64_t key = frame.number != 0 ? frame.number : common::crc32(frame.file.filename().string());
    return key % count == index - 1;
}

std::string Shard::text() const { return fmt::format("{}/{}", index, count); }

Result<Shard> parse_shard(std::string_view text) {
    Shard shard;
    const char* const end = text.data() + text.size();
    const auto index = std::from_chars(text.data(), end, shard.index);
    const bool divided = index.ec == std::errc() && index.ptr != end && *index.ptr == '/';
    const auto count = divided ? std::from_chars(index.ptr + 1, end, shard.count) : index;
    if (!divided || count.ec != std::errc() || count.ptr != end) {
        return fail(ErrorCode::invalid_argument, fmt::format("\"{:.60}\" is no shard", text),
                    "write 1/4, 2/4, 3/4, 4/4");
    }
    if (shard.count > kMaxShards)
        return fail(ErrorCode::invalid_argument,
                    fmt::format("\"{:.60}\" asks for more than {} shards", text, kMaxShards),
                    "use fewer and larger ones");
    if (shard.index < 1 || shard.index > shard.count) {
        return fail(
            ErrorCode::invalid_argument, fmt::format("there is no shard {} of {}", shard.index, shard.count),
            shard.count == 0 ? "write 1/4, 2/4, 3/4, 4/4" : fmt::format("they are 1/{0} to {0}/{0}", shard.count));
    }
    return shard;
}

std::string written_name(const ArchivedFile& frame) {
    const std::string quoted = to_text(frame.file.filename().string());
    return quoted.substr(1, quoted.size() - 2);
}

Result<void> put_in_order(std::vector<ArchivedFile>& frames) {
    std::vector<std::pair<std::string, ArchivedFile>> named;
    named.reserve(frames.size());
    for (ArchivedFile& frame : frames) named.emplace_back(written_name(frame), std::move(frame));
    std::sort(named.begin(), named.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    frames.clear();
    for (auto& [name, frame] : named) frames.push_back(std::move(frame));
    const auto twice =
        std::adjacent_find(named.begin(), named.end(), [](const auto& a, const auto& b) { return a.first == b.first; });
    if (twice == named.end()) return {};
    return fail(ErrorCode::invalid_argument, "two frames are called " + twice->first, "name each frame once");
}

void replay_all(const std::vector<ArchivedFile>& frames, const std::optional<algo::Recipe>& recipe, unsigned jobs,
                const std::function<bool(const ArchivedFile&, Result<Replayed>)>& take) {
    jobs = std::max(jobs, 1U);
    std::vector<std::unique_ptr<Replay>> judges;
    for (unsigned k = 0; k < jobs; ++k) judges.push_back(std::make_unique<Replay>(recipe));
    if (jobs == 1) {
        for (const ArchivedFile& frame : frames) {
            if (!take(frame, judges[0]->judge(frame.file))) return;
        }
        return;
    }
    // Block by block: the threads share its frames; `take` gets the results in order when all are there.
    const std::size_t block = std::size_t{64} * jobs;
    std::vector<std::optional<Result<Replayed>>> judged(block);
    for (std::size_t begin = 0; begin < frames.size(); begin += block) {
        const std::size_t size = std::min(block, frames.size() - begin);
        std::atomic<std::size_t> next{0};
        {
            std::vector<std::jthread> threads;
            for (auto& judge : judges) {
                threads.emplace_back([&, one = judge.get()] {
                    for (std::size_t k = next++; k < size; k = next++)
                        judged[k].emplace(one->judge(frames[begin + k].file));
                });
            }
        }
        for (std::size_t k = 0; k < size; ++k) {
            if (!take(frames[begin + k], std::move(*judged[k]))) return;
        }
    }
}

}  // namespace hord::firmware::store
