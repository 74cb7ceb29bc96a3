#include "firmware/store/frames/replay_shard.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <queue>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/file_writing.h"
#include "common/json_integer.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::store {
namespace {

using common::integer_of;

namespace fs = std::filesystem;

constexpr std::string_view kFrame = "{\"frame\":\"", kTrailer = "{\"records\":", kHeader = "{\"hord_replay\":";
constexpr std::size_t kWrittenAtOnce = 1U << 16U;
constexpr std::size_t kLongestLine = 16U << 20U;  // a frame with every defect there can be

std::string header_of(const ReplayIdentity& id, const Shard& shard) {
    return to_text({{"hord_replay", 1},
                    {"archive", id.archive},
                    {"frames", id.frames},
                    {"recipe", id.recipe},
                    {"software", id.software},
                    {"program", id.program},
                    {"shard", shard.text()}});
}

std::string trailer_of(const ReplayTally& tally, const std::string& sum) {
    return to_text({{"records", tally.records},
                    {"same", tally.same},
                    {"verdicts", tally.verdicts},
                    {"unreadable", tally.unreadable},
                    {"sha256", sum}});
}

// The frame's name in a line, still escaped; empty: not a line of a frame.
std::string_view frame_of(std::string_view line) {
    if (!line.starts_with(kFrame)) return {};
    line.remove_prefix(kFrame.size());
    for (std::size_t k = 0; k < line.size(); ++k) {
        if (line[k] == '\\') ++k;
        else if (line[k] == '"') return line.substr(0, k);
    }
    return {};
}

void count(std::string_view line, ReplayTally& tally) {
    ++tally.records;
    const auto after = line.substr(std::min(line.size(), kFrame.size() + frame_of(line).size() + 1));
    if (after.starts_with(",\"unreadable\"")) ++tally.unreadable;
    else if (line.ends_with("\"changes\":[]}")) ++tally.same;
    else if (line.find("\"changes\":[\"verdict\"") != std::string_view::npos) ++tally.verdicts;
}

}  // namespace

std::string archive_identity(const std::vector<ArchivedFile>& frames) {
    Sha256 sum;
    for (const ArchivedFile& frame : frames) sum.add(fmt::format("{} {}\n", written_name(frame), frame.bytes));
    return to_hex(sum.digest());
}

std::string text_identity(std::string_view text) {
    Sha256 sum;
    sum.add(text);
    return to_hex(sum.digest());
}

Result<std::string> program_identity() {
    std::ifstream in("/proc/self/exe", std::ios::binary);
    Sha256 sum;
    std::array<char, 1U << 16U> bytes{};
    while (in.read(bytes.data(), bytes.size()) || in.gcount() > 0)
        sum.add(std::string_view(bytes.data(), static_cast<std::size_t>(in.gcount())));
    if (!in.eof()) return fail(ErrorCode::io, "the program's own file cannot be read", "mount /proc");
    return to_hex(sum.digest());
}

std::string unreadable_line(const std::string& frame, ErrorCode why) {
    return to_text(
        {{"frame", frame}, {"unreadable", why == ErrorCode::unreadable ? "damaged" : "the recipe does not fit it"}});
}

// -- writing

ShardWriter::~ShardWriter() {
    if (fd_) ::unlink(beside_.c_str());
}

Result<ShardWriter> ShardWriter::create(const fs::path& file, const ReplayIdentity& identity, const Shard& shard) {
    if (auto fine = common::check_replaceable(file); !fine) return tl::unexpected(fine.error());
    ShardWriter writer(file);
    // A unique temporary name: two workers may write the same shard if one was assumed dead.
    std::string beside = file.string() + ".part.XXXXXX";
    writer.fd_.reset(::mkostemp(beside.data(), O_CLOEXEC));
    if (!writer.fd_) return writer.failed(errno);
    writer.beside_ = std::move(beside);
    ::fchmod(writer.fd_.get(), 0644);
    if (auto done = writer.write(header_of(identity, shard)); !done) return tl::unexpected(done.error());
    return writer;
}

tl::unexpected<Error> ShardWriter::failed(int why) const {
    return fail(ErrorCode::io, file_.string() + " cannot be written (" + std::strerror(why) + ")",
                why == ENOSPC ? "free space on its disk" : "check the folder's owner and its disk");
}

Result<void> ShardWriter::write(std::string_view line) {
    waiting_.append(line).append("\n");
    return waiting_.size() < kWrittenAtOnce ? Result<void>{} : flush();
}

Result<void> ShardWriter::flush() {
    sum_.add(waiting_);
    const int why = common::write_all(fd_.get(), std::as_bytes(std::span(waiting_)));
    waiting_.clear();
    if (why != 0) return failed(why);
    return {};
}

Result<void> ShardWriter::add(std::string_view line) {
    count(line, tally_);
    return write(line);
}

Result<ReplayTally> ShardWriter::finish() {
    if (auto done = flush(); !done) return tl::unexpected(done.error());
    if (auto done = write(trailer_of(tally_, to_hex(sum_.digest()))).and_then([&] { return flush(); }); !done)
        return tl::unexpected(done.error());
    if (::fsync(fd_.get()) != 0 || ::rename(beside_.c_str(), file_.c_str()) != 0) return failed(errno);
    int why = fd_.close();
    if (why == 0) why = common::sync_folder_of(file_);
    if (why != 0) return failed(why);
    return tally_;
}

// -- merging

namespace {

// Reads one shard line by line.
class ShardReader {
  public:
    static Result<ShardReader> open(const fs::path& file) {
        ShardReader reader(file);
        if (!reader.in_)
            return fail(ErrorCode::not_found, file.string() + " cannot be read (" + std::strerror(errno) + ")",
                        "check the path");
        std::string beginning(kHeader.size(), '\0');
        std::error_code error;
        const bool ours = fs::is_regular_file(file, error) &&
            reader.in_.read(beginning.data(), static_cast<std::streamsize>(beginning.size())) && beginning == kHeader;
        if (!ours) return reader.foreign();
        reader.in_.seekg(0);
        auto first = reader.next_line();
        if (!first) return tl::unexpected(first.error());
        const Json json = Json::parse(reader.line_, nullptr, false);
        try {
            if (integer_of<int>(json.at("hord_replay")) != 1) {
                return fail(ErrorCode::unsupported, file.string() + " was written by other software",
                            "replay and merge with one software");
            }
            reader.identity_ = {json.at("archive").get<std::string>(), integer_of<std::uint64_t>(json.at("frames")),
                                json.at("recipe").get<std::string>(), json.at("software").get<std::string>(),
                                json.at("program").get<std::string>()};
            auto shard = parse_shard(json.at("shard").get<std::string>());
            if (!shard) return reader.foreign();
            reader.shard_ = *shard;
        } catch (const Json::exception&) {
            return reader.foreign();
        }
        return reader;
    }

    // True: line() is the next frame's. False: the end of a complete shard.
    Result<bool> next() {
        const Sha256 before = sum_;
        if (auto read = next_line(); !read) return tl::unexpected(read.error());
        if (line_.starts_with(kTrailer)) {
            if (line_ != trailer_of(tally_, to_hex(before.digest()))) return torn("its checksum is another");
            if (in_.peek() != std::ifstream::traits_type::eof()) return torn("something follows its end");
            line_.clear();
            return false;
        }
        std::string frame(frame_of(line_));
        if (frame.empty() || frame <= frame_) return torn("a line is out of place");
        frame_ = std::move(frame);
        count(line_, tally_);
        return true;
    }

    [[nodiscard]] const fs::path& file() const { return file_; }
    [[nodiscard]] const ReplayIdentity& identity() const { return identity_; }
    [[nodiscard]] const Shard& shard() const { return shard_; }
    [[nodiscard]] const std::string& line() const { return line_; }
    [[nodiscard]] const std::string& frame() const { return frame_; }

  private:
    explicit ShardReader(fs::path file) : file_(std::move(file)), in_(file_, std::ios::binary) {}

    [[nodiscard]] tl::unexpected<Error> torn(const char* how) const {
        return fail(ErrorCode::unreadable, fmt::format("{} is torn or was changed: {}", file_.string(), how),
                    fmt::format("replay shard {} again", shard_.text()));
    }
    [[nodiscard]] tl::unexpected<Error> foreign() const {
        return fail(ErrorCode::unreadable, file_.string() + " is no shard of a replay",
                    "merge files that hordctl replay --shard I/N --out FILE wrote");
    }
    // Keeps at most kLongestLine bytes of a line that has no end.
    Result<void> next_line() {
        const auto refuse = [&](const char* how) { return identity_.archive.empty() ? foreign() : torn(how); };
        constexpr auto kEnd = std::ifstream::traits_type::eof();
        line_.clear();
        for (auto c = in_.rdbuf()->sbumpc(); c != '\n'; c = in_.rdbuf()->sbumpc()) {
            if (c == kEnd) return refuse(line_.empty() ? "its end is missing" : "its last line is cut off");
            if (line_.size() == kLongestLine) return refuse("a line is longer than 16 MB");
            line_.push_back(static_cast<char>(c));
        }
        sum_.add(line_);
        sum_.add("\n");
        return {};
    }

    fs::path file_;
    std::ifstream in_;
    std::string line_, frame_;
    ReplayIdentity identity_;
    Shard shard_;
    Sha256 sum_;
    ReplayTally tally_;
};

Result<void> belongs(const ShardReader& one, const ShardReader& other) {
    const auto differ = [&](const char* what, const std::string& a, const std::string& b) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{} and {} are of different replays: {} {} and {}", one.file().string(),
                                other.file().string(), what, a.substr(0, 16), b.substr(0, 16)),
                    "replay the odd one again, from the same frames with the same recipe and software");
    };
    const ReplayIdentity &a = one.identity(), &b = other.identity();
    if (a.archive != b.archive || a.frames != b.frames) return differ("archive", a.archive, b.archive);
    if (a.recipe != b.recipe) return differ("recipe", a.recipe, b.recipe);
    if (a.software != b.software) return differ("software", a.software, b.software);
    if (a.program != b.program) return differ("program", a.program, b.program);
    if (one.shard().count != other.shard().count) return differ("shards", one.shard().text(), other.shard().text());
    return {};
}

// Checks that each shard is there once and all are of one replay.
Result<void> check_set(const std::vector<ShardReader>& shards) {
    std::map<std::uint64_t, const ShardReader*> by_index;
    for (const ShardReader& shard : shards) {
        if (auto same = belongs(shards.front(), shard); !same) return same;
        const auto [at, is_new] = by_index.emplace(shard.shard().index, &shard);
        if (!is_new) {
            return fail(ErrorCode::invalid_argument,
                        fmt::format("{} and {} are both shard {}", at->second->file().string(), shard.file().string(),
                                    shard.shard().text()),
                        "name each shard once");
        }
    }
    const std::uint64_t wanted = shards.front().shard().count;
    if (by_index.size() == wanted) return {};
    std::string missing;
    std::uint64_t named = 0;
    for (std::uint64_t k = 1; k <= wanted && named < 10; ++k) {
        if (by_index.contains(k)) continue;
        missing += fmt::format("{}{}/{}", missing.empty() ? "" : ", ", k, wanted);
        ++named;
    }
    const std::uint64_t count = wanted - by_index.size();
    return fail(ErrorCode::invalid_argument,
                fmt::format("{} of {} shards are missing: {}{}", count, wanted, missing, count > named ? " ..." : ""),
                "replay them, and name their files, too");
}

}  // namespace

Result<ReplayTally> merge_shards(const std::vector<fs::path>& files, const fs::path& out) {
    if (files.empty()) return fail(ErrorCode::invalid_argument, "there is nothing to merge", "name the shards' files");
    rlimit descriptors{};
    if (::getrlimit(RLIMIT_NOFILE, &descriptors) == 0) {  // one a shard
        descriptors.rlim_cur = descriptors.rlim_max;
        (void)::setrlimit(RLIMIT_NOFILE, &descriptors);
    }
    std::vector<ShardReader> shards;
    for (const fs::path& file : files) {
        auto shard = ShardReader::open(file);
        if (!shard) return tl::unexpected(shard.error());
        shards.push_back(std::move(*shard));
    }
    if (auto whole = check_set(shards); !whole) return tl::unexpected(whole.error());
    auto writer = ShardWriter::create(out, shards.front().identity(), Shard{});
    if (!writer) return tl::unexpected(writer.error());

    const auto later = [&](std::size_t a, std::size_t b) { return shards[a].frame() > shards[b].frame(); };
    std::priority_queue<std::size_t, std::vector<std::size_t>, decltype(later)> waiting(later);
    const auto advance = [&](std::size_t k) -> Result<void> {
        const auto more = shards[k].next();
        if (!more) return tl::unexpected(more.error());
        if (*more) waiting.push(k);
        return {};
    };
    for (std::size_t k = 0; k < shards.size(); ++k) {
        if (auto done = advance(k); !done) return tl::unexpected(done.error());
    }
    std::uint64_t frames = 0;
    std::string last;
    while (!waiting.empty()) {
        const std::size_t first = waiting.top();
        waiting.pop();
        ShardReader& shard = shards[first];
        if (frames++ > 0 && shard.frame() == last) {
            return fail(ErrorCode::invalid_argument,
                        fmt::format("{} holds {}, which another shard holds, too", shard.file().string(), last),
                        "replay all shards with one software");
        }
        last = shard.frame();
        if (auto done = writer->add(shard.line()).and_then([&] { return advance(first); }); !done)
            return tl::unexpected(done.error());
    }
    if (frames != shards.front().identity().frames) {
        return fail(
            ErrorCode::invalid_argument,
            fmt::format("the shards hold {} frames, and the archive {}", frames, shards.front().identity().frames),
            "replay all shards with one software");
    }
    return writer->finish();
}

}  // namespace hord::firmware::store
