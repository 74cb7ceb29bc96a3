#include "firmware/recipes/reference_file.h"

#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/crc32.h"
#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/regular_file.h"
#include "common/unique_fd.h"

namespace hord::firmware {
namespace {

static_assert(std::endian::native == std::endian::little, "the file is little-endian, and written as memory has it");

constexpr std::string_view kMagic = "HORDREF\n";

// Calls `each` with the values of the file's head, and with its maps and their values a lenslet, in the file's order.
template <class AnyReference, class Each>
void each_value(AnyReference& r, Each&& each) {
    static_assert(sizeof(int) == sizeof(std::uint32_t), "the file has 32 bits");
    for (auto* v : {&r.extents.m, &r.extents.n, &r.extents.i, &r.extents.j, &r.bits}) each(*v);
    for (auto* v : {&r.levels.dark, &r.levels.min_sum, &r.levels.saturated, &r.parts}) each(*v);
    for (auto* v : {&r.sensor.electrons_per_dn, &r.sensor.read_dn, &r.sensor.clip_dn}) each(*v);
}
template <class AnyReference, class Each>
void each_map(AnyReference& r, Each&& each) {
    each(r.shares, r.stride());
    for (auto* map : {&r.light, &r.x, &r.y, &r.emd, &r.frobenius}) each(*map, std::size_t{1});
    for (auto& map : r.spread) each(map, std::size_t{1});
    each(r.mask, std::size_t{1});
}

template <class T>
void put(std::string& text, std::span<const T> values) {
    text.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

// Precondition: `rest` has at least as many bytes as `values`. Not by memcpy(): it takes no null, not even for 0 bytes.
template <class T>
void take(std::string_view& rest, std::span<T> values) {
    rest.copy(reinterpret_cast<char*>(values.data()), values.size_bytes());
    rest.remove_prefix(values.size_bytes());
}

// Everything but the checksum.
std::string bytes_of(const algo::Reference& r) {
    std::string text(kMagic);
    put(text, std::span(&kReferenceVersion, 1));
    each_value(r, [&](const auto& value) { put(text, std::span(&value, 1)); });
    each_map(r, [&](const auto& map, std::size_t) { put(text, std::span(map)); });
    put(text, std::span<const float>(r.size_limits));
    put(text, std::span<const float>(r.blur_limits));
    put(text, std::span(&r.patch_limit, 1));
    put(text, std::span(r.pooled_scales));
    return text;
}

// Cached checksums of the existing references.
struct KnownSums {
    std::mutex mutex;
    std::vector<std::pair<std::weak_ptr<const algo::Reference>, std::uint32_t>> sums;

    void keep(const std::shared_ptr<const algo::Reference>& reference, std::uint32_t sum) {
        const std::lock_guard lock(mutex);
        std::erase_if(sums, [](const auto& known) { return known.first.expired(); });
        sums.emplace_back(reference, sum);
    }
} known_sums;

constexpr const char* kGiveReference = "give a file that hordctl learn has written";

// errno has the reason.
Error cannot_read(const std::filesystem::path& file) {
    const bool may_not = errno == EACCES;
    Error error = common::cannot_read(file);
    error.cure = may_not ? "give this user the right to read it" : kGiveReference;
    return error;
}

}  // namespace

std::size_t bytes_of_maps(const algo::Extents& extents) {
    algo::Reference r;
    r.extents = extents;
    std::size_t bytes_a_lenslet = 0;
    each_map(r, [&](const auto& map, std::size_t values) { bytes_a_lenslet += values * sizeof map[0]; });
    return extents.lenslets() * bytes_a_lenslet;
}

std::uint32_t crc32_of(const std::shared_ptr<const algo::Reference>& reference) {
    {
        const std::lock_guard lock(known_sums.mutex);
        for (const auto& [known, sum] : known_sums.sums) {
            if (known.lock() == reference) return sum;
        }
    }
    const std::uint32_t sum = common::crc32(bytes_of(*reference));
    known_sums.keep(reference, sum);
    return sum;
}

Result<void> write_reference(const std::filesystem::path& file, const algo::Reference& r) {
    if (auto fine = check(r); !fine) return fine;
    std::string text = bytes_of(r);
    const std::uint32_t sum = common::crc32(text);
    put(text, std::span(&sum, 1));
    return common::write_durably(file, text);
}

Result<ReferenceFacts> read_reference_facts(const std::filesystem::path& file) {
    const auto refuse = [&](ErrorCode code, const std::string& what) {
        return fail(code, file.string() + " " + what, "learn it again: hordctl learn");
    };
    const common::UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
    if (!fd) return tl::unexpected(cannot_read(file));
    algo::Reference r;
    std::size_t head_bytes = 0;
    each_value(r, [&](const auto& value) { head_bytes += sizeof value; });
    struct stat what {};
    std::string head(kMagic.size() + sizeof(std::uint32_t) + head_bytes, '\0');
    ReferenceFacts facts;
    const auto read = [&](void* to, std::size_t bytes, off_t from) {
        return ::pread(fd.get(), to, bytes, from) == static_cast<ssize_t>(bytes);
    };
    if (::fstat(fd.get(), &what) != 0 || !S_ISREG(what.st_mode) || !read(head.data(), head.size(), 0) ||
        !head.starts_with(kMagic) || !read(&facts.crc32, sizeof facts.crc32, what.st_size - off_t{sizeof facts.crc32}))
        return refuse(ErrorCode::unreadable, "is not a reference");
    std::uint32_t version = 0;
    std::memcpy(&version, head.data() + kMagic.size(), sizeof version);
    if (version < kOldestReferenceVersion || version > kReferenceVersion)
        return refuse(ErrorCode::unsupported, fmt::format("is a reference of version {}", version));
    std::string_view rest = std::string_view(head).substr(kMagic.size() + sizeof version);
    each_value(r, [&](auto& value) { take(rest, std::span(&value, 1)); });
    facts.extents = r.extents;
    facts.parts = r.parts;
    return facts;
}

std::filesystem::path report_file(const std::filesystem::path& reference, std::string_view ending) {
    std::filesystem::path file = reference;
    file.replace_extension();
    return file += ending;
}

Result<std::shared_ptr<const algo::Reference>> read_reference(const std::filesystem::path& file) {
    const auto refuse = [&](ErrorCode code, const std::string& what) {
        return fail(code, file.string() + " " + what, "learn it again: hordctl learn");
    };
    // A pipe may keep a running station waiting. Of a folder cannot_read() tells.
    std::error_code none;
    if (const auto fine = common::check_regular(file, kGiveReference);
        !fine && !std::filesystem::is_directory(file, none))
        return fail(ErrorCode::unreadable, fine.error().what, fine.error().cure);
    const auto read = common::read_file(file);
    if (!read) return tl::unexpected(cannot_read(file));
    const std::string& text = *read;
    if (auto right = common::require_kind(text, file.string(), common::FileKind::reference); !right)
        return tl::unexpected(right.error());
    if (text.size() < kMagic.size() + 8 || !text.starts_with(kMagic))
        return refuse(ErrorCode::unreadable, "is not a reference");
    std::uint32_t version = 0, seal = 0;
    std::memcpy(&version, text.data() + kMagic.size(), sizeof version);
    if (version < kOldestReferenceVersion || version > kReferenceVersion) {
        return refuse(ErrorCode::unsupported,
                      fmt::format("is a reference of version {}, this program reads {} to {}", version,
                                  kOldestReferenceVersion, kReferenceVersion));
    }
    const std::string_view sealed = std::string_view(text).substr(0, text.size() - sizeof seal);
    std::memcpy(&seal, text.data() + sealed.size(), sizeof seal);
    if (common::crc32(sealed) != seal) return refuse(ErrorCode::unreadable, "is damaged: its checksum is wrong");

    auto r = std::make_shared<algo::Reference>();
    std::string_view rest = sealed.substr(kMagic.size() + sizeof version);
    std::size_t head_bytes = 0;
    each_value(*r, [&](const auto& value) { head_bytes += sizeof value; });
    if (rest.size() < head_bytes) return refuse(ErrorCode::unreadable, "is not a whole reference");
    each_value(*r, [&](auto& value) { take(rest, std::span(&value, 1)); });
    const std::size_t sizes = version < 3 ? 0 : sizeof r->size_limits,
                      fourth = version < 4 ? 0 : sizeof r->blur_limits + sizeof r->patch_limit,
                      maps = check(r->extents) ? bytes_of_maps(r->extents) + sizes + fourth : rest.size() + 1,
                      scales = rest.size() < maps ? 0 : (rest.size() - maps) / sizeof(float);
    if (rest.size() != maps + scales * sizeof(float) || (version == 1 && scales != 0))
        return refuse(ErrorCode::unreadable, "is not a whole reference");
    each_map(*r, [&](auto& map, std::size_t values) {
        map.resize(values * r->extents.lenslets());
        take(rest, std::span(map));
    });
    if (sizes != 0) take(rest, std::span<float>(r->size_limits));
    if (fourth != 0) {
        take(rest, std::span<float>(r->blur_limits));
        take(rest, std::span(&r->patch_limit, 1));
    }
    r->pooled_scales.resize(scales);
    take(rest, std::span(r->pooled_scales));
    if (auto fine = check(*r); !fine) return refuse(ErrorCode::unreadable, "is not sound: " + fine.error().what);
    known_sums.keep(r, seal);
    return r;
}

}  // namespace hord::firmware
