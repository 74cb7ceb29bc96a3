#include "firmware/recipes/reference_file.h"

#include <bit>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/file_writing.h"

namespace hord::firmware {
namespace {

static_assert(std::endian::native == std::endian::little, "the file is little-endian, and written as memory has it");

constexpr std::string_view kMagic = "HORDREF\n";

class Writer {
  public:
    template <class T>
    requires std::is_arithmetic_v<T>
    void put(T value) { text_.append(reinterpret_cast<const char*>(&value), sizeof value); }
    template <class T>
    void put(const std::vector<T>& values) {
        text_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    }
    std::string text_;
};

class Reader {
  public:
    explicit Reader(std::string_view text) : rest_(text) {}
    template <class T>
    requires std::is_arithmetic_v<T>
    void get(T& value) { take(&value, sizeof value); }
    template <class T>
    void get(std::vector<T>& values, std::size_t count) {
        if (rest_.size() / sizeof(T) < count) {
            whole_ = false;
            return;
        }
        values.resize(count);
        take(values.data(), count * sizeof(T));
    }
    [[nodiscard]] bool at_end() const { return whole_ && rest_.empty(); }
    [[nodiscard]] bool whole() const { return whole_; }

  private:
    void take(void* to, std::size_t bytes) {
        whole_ = whole_ && rest_.size() >= bytes;
        if (!whole_) return;
        std::memcpy(to, rest_.data(), bytes);
        rest_.remove_prefix(bytes);
    }
    std::string_view rest_;
    bool whole_ = true;
};

// Everything but the checksum.
std::string bytes_of(const algo::Reference& r) {
    Writer w;
    w.text_ = kMagic;
    w.put(kReferenceVersion);
    for (const int v : {r.extents.m, r.extents.n, r.extents.i, r.extents.j, r.bits})
        w.put(static_cast<std::uint32_t>(v));
    for (const std::uint32_t v : {r.levels.dark, r.levels.min_sum, r.levels.saturated, r.parts}) w.put(v);
    w.put(r.sensor.electrons_per_dn);
    w.put(r.sensor.read_dn);
    w.put(r.sensor.clip_dn);
    w.put(r.shares);
    for (const auto* map : {&r.light, &r.x, &r.y, &r.emd, &r.frobenius}) w.put(*map);
    for (const auto& map : r.spread) w.put(map);
    w.put(r.mask);
    return std::move(w.text_);
}

// Cached checksums of the existing references.
class KnownSums {
  public:
    std::optional<std::uint32_t> find(const std::shared_ptr<const algo::Reference>& reference) {
        const std::lock_guard lock(mutex_);
        std::erase_if(known_, [](const Known& k) { return k.reference.expired(); });
        for (const Known& k : known_) {
            if (k.reference.lock() == reference) return k.sum;
        }
        return std::nullopt;
    }
    void keep(const std::shared_ptr<const algo::Reference>& reference, std::uint32_t sum) {
        const std::lock_guard lock(mutex_);
        known_.push_back({reference, sum});
    }

  private:
    struct Known {
        std::weak_ptr<const algo::Reference> reference;
        std::uint32_t sum;
    };
    std::mutex mutex_;
    std::vector<Known> known_;
};
KnownSums& known_sums() {
    static KnownSums sums;
    return sums;
}

}  // namespace

std::uint32_t crc32_of(const std::shared_ptr<const algo::Reference>& reference) {
    if (const auto known = known_sums().find(reference)) return *known;
    const std::uint32_t sum = common::crc32(bytes_of(*reference));
    known_sums().keep(reference, sum);
    return sum;
}

Result<void> write_reference(const std::filesystem::path& file, const algo::Reference& r) {
    if (auto fine = check(r); !fine) return fine;
    Writer w;
    w.text_ = bytes_of(r);
    w.put(common::crc32(w.text_));
    return common::write_durably(file, w.text_);
}

Result<std::shared_ptr<const algo::Reference>> read_reference(const std::filesystem::path& file) {
    const auto refuse = [&](ErrorCode code, const std::string& what) {
        return fail(code, file.string() + " " + what, "learn it again: hordctl learn");
    };
    std::ifstream stream(file, std::ios::binary);
    if (!stream)
        return fail(ErrorCode::not_found, file.string() + " cannot be opened",
                    "give a file that hordctl learn has written");
    const std::string text{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
    if (text.size() < kMagic.size() + 8 || !text.starts_with(kMagic))
        return refuse(ErrorCode::unreadable, "is not a reference");
    std::uint32_t version = 0, seal = 0;
    std::memcpy(&version, text.data() + kMagic.size(), sizeof version);
    if (version != kReferenceVersion) {
        return refuse(ErrorCode::unsupported,
                      fmt::format("is a reference of version {}, this program reads {}", version, kReferenceVersion));
    }
    const std::string_view sealed = std::string_view(text).substr(0, text.size() - sizeof seal);
    std::memcpy(&seal, text.data() + sealed.size(), sizeof seal);
    if (common::crc32(sealed) != seal) return refuse(ErrorCode::unreadable, "is damaged: its checksum is wrong");

    auto r = std::make_shared<algo::Reference>();
    Reader reader(sealed.substr(kMagic.size() + sizeof version));
    std::uint32_t m = 0, n = 0, i = 0, j = 0, bits = 0;
    for (std::uint32_t* v :
         {&m, &n, &i, &j, &bits, &r->levels.dark, &r->levels.min_sum, &r->levels.saturated, &r->parts})
        reader.get(*v);
    reader.get(r->sensor.electrons_per_dn);
    reader.get(r->sensor.read_dn);
    reader.get(r->sensor.clip_dn);
    r->extents = {static_cast<int>(m), static_cast<int>(n), static_cast<int>(i), static_cast<int>(j)};
    r->bits = static_cast<int>(bits);
    if (auto fine = check(r->extents); !reader.whole() || !fine)
        return refuse(ErrorCode::unreadable, "is not a whole reference");
    const std::size_t count = r->extents.lenslets();
    reader.get(r->shares, count * r->stride());
    for (auto* map : {&r->light, &r->x, &r->y, &r->emd, &r->frobenius}) reader.get(*map, count);
    for (auto& map : r->spread) reader.get(map, count);
    reader.get(r->mask, count);
    if (!reader.at_end()) return refuse(ErrorCode::unreadable, "is not a whole reference");
    if (auto fine = check(*r); !fine) return refuse(ErrorCode::unreadable, "is not sound: " + fine.error().what);
    known_sums().keep(r, seal);
    return r;
}

}  // namespace hord::firmware
