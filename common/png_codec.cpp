#include "common/png_codec.h"

#include <algorithm>
#include <csetjmp>
#include <cstddef>
#include <cstring>
#include <memory>
#include <new>
#include <utility>

#include <png.h>
#include <zlib.h>

namespace hord::common {
namespace {

constexpr png_uint_32 kLargestSide = 32'768;  // larger than any light field
// Deflate encodes at most 258 bytes in 2 bits.
constexpr std::uint64_t kMaxUnpacked = 258 * 8 / 2;
constexpr int kMaxTexts = 16;
constexpr png_alloc_size_t kLongestText = 8'000'000;

// The state of a libpng call. libpng reports errors by longjmp, which skips destructors: so everything that has one is
// here, outside the functions that call libpng.
struct Job {
    std::string why;
    const char* not_grey = nullptr;  // what the file is instead
    std::vector<png_bytep> rows;
    // writing
    std::vector<std::uint8_t> written;
    // reading
    std::span<const std::uint8_t> to_read;
    std::function<Result<void>(std::uint32_t, std::uint32_t)> check_size;
    std::optional<Error> refused;  // by it
    GreyPng read;
    bool done = false;
};

void on_error(png_structp png, png_const_charp why) {
    static_cast<Job*>(png_get_error_ptr(png))->why = why;
    png_longjmp(png, 1);
}
void on_warning(png_structp /*png*/, png_const_charp /*why*/) {}

// libpng's two structures, to write with or to read with.
struct Png {
    Png(Job& job, bool writes)
        : writing(writes), png((writes ? png_create_write_struct : png_create_read_struct)(PNG_LIBPNG_VER_STRING, &job,
                                                                                           on_error, on_warning)) {
        if (png != nullptr) info = png_create_info_struct(png);
    }
    ~Png() {
        if (writing) png_destroy_write_struct(&png, &info);
        else png_destroy_read_struct(&png, &info, nullptr);
    }
    Png(const Png&) = delete;
    Png& operator=(const Png&) = delete;
    const bool writing;
    png_structp png;
    png_infop info = nullptr;
};

bool append(std::vector<std::uint8_t>& to, png_bytep bytes, std::size_t count) {
    try {
        to.insert(to.end(), bytes, bytes + count);
        return true;
    } catch (const std::bad_alloc&) {  // must not pass through libpng
        return false;
    }
}
void on_write(png_structp png, png_bytep bytes, std::size_t count) {
    if (!append(static_cast<Job*>(png_get_io_ptr(png))->written, bytes, count)) png_error(png, "no memory is left");
}
void on_flush(png_structp /*png*/) {}

void on_read(png_structp png, png_bytep bytes, std::size_t count) {
    auto& job = *static_cast<Job*>(png_get_io_ptr(png));
    if (job.to_read.size() - job.read.length < count) png_error(png, "it is cut off");
    std::memcpy(bytes, job.to_read.data() + job.read.length, count);
    job.read.length += count;
}

// The image header for libpng.
struct Layout {
    int width_px = 0;
    int height_px = 0;
    int depth = 8;
    bool colour = false;
    int significant_bits = 0;              // 0: no sBIT
    std::span<const png_color> palette{};  // not empty: the samples are indexes into it
};

void write_all(const Png& to, Job& job, const Layout& layout, const PngPacking& packing, png_textp note) {
    if (setjmp(png_jmpbuf(to.png)) != 0) return;
    png_set_write_fn(to.png, &job, on_write, on_flush);
    png_set_compression_level(to.png, packing.level);
    if (packing.runs_only) png_set_compression_strategy(to.png, Z_RLE);
    png_set_filter(to.png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_set_IHDR(to.png, to.info, static_cast<png_uint_32>(layout.width_px), static_cast<png_uint_32>(layout.height_px),
                 layout.depth,
                 !layout.palette.empty() ? PNG_COLOR_TYPE_PALETTE
                     : layout.colour     ? PNG_COLOR_TYPE_RGB
                                         : PNG_COLOR_TYPE_GRAY,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (!layout.palette.empty())
        png_set_PLTE(to.png, to.info, layout.palette.data(), static_cast<int>(layout.palette.size()));
    if (layout.significant_bits != 0) {
        png_color_8 depth{};
        depth.gray = static_cast<png_byte>(layout.significant_bits);
        png_set_sBIT(to.png, to.info, &depth);
    }
    if (note != nullptr) png_set_text(to.png, to.info, note, 1);
    png_write_info(to.png, to.info);
    if (layout.depth == 16) png_set_swap(to.png);
    if (layout.colour) png_set_bgr(to.png);
    png_write_image(to.png, job.rows.data());
    png_write_end(to.png, to.info);
    job.done = true;
}

Result<std::vector<std::uint8_t>> encode(Job& job, const Layout& layout, const PngPacking& packing, png_textp note) {
    const Png writer(job, true);
    if (writer.info != nullptr) write_all(writer, job, layout, packing, note);
    if (!job.done) return fail(ErrorCode::internal, "a picture cannot be made a PNG (" + job.why + ")", "report it");
    return std::move(job.written);
}

void read_all(const Png& from, Job& job, const std::string& keyword) {
    if (setjmp(png_jmpbuf(from.png)) != 0) return;
    png_set_read_fn(from.png, &job, on_read);
    png_set_crc_action(from.png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
    png_set_user_limits(from.png, kLargestSide, kLargestSide);
    png_set_keep_unknown_chunks(from.png, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
    if (!keyword.empty()) {
        static constexpr png_byte wanted[] = "sBIT\0iTXt";
        png_set_keep_unknown_chunks(from.png, PNG_HANDLE_CHUNK_AS_DEFAULT, wanted, 2);
        png_set_chunk_cache_max(from.png, kMaxTexts);
        png_set_chunk_malloc_max(from.png, kLongestText);
        png_set_benign_errors(from.png, 0);  // refuses a longer chunk; else libpng would warn and allocate the memory
    }
    png_read_info(from.png, from.info);
    const int depth = png_get_bit_depth(from.png, from.info);
    switch (png_get_color_type(from.png, from.info)) {
        case PNG_COLOR_TYPE_GRAY:
            job.not_grey = depth == 8 || depth == 16 ? nullptr : "less than 8 bits a sample";
            break;
        case PNG_COLOR_TYPE_GRAY_ALPHA: job.not_grey = "grey with alpha"; break;
        case PNG_COLOR_TYPE_PALETTE: job.not_grey = "palette"; break;
        case PNG_COLOR_TYPE_RGB_ALPHA: job.not_grey = "colour with alpha"; break;
        default: job.not_grey = "colour"; break;
    }
    if (job.not_grey != nullptr) return;
    int bits = depth;
    png_color_8p significant = nullptr;
    if (png_get_sBIT(from.png, from.info, &significant) != 0 && depth == 16 && significant->gray > 8 &&
        significant->gray <= 16)
        bits = significant->gray;
    if (depth == 16) png_set_swap(from.png);
    const auto width = png_get_image_width(from.png, from.info), height = png_get_image_height(from.png, from.info);
    if (auto good = job.check_size(width, height); !good) job.refused = std::move(good.error());
    if (job.refused) return;
    const std::size_t row_bytes = static_cast<std::size_t>(width) * (depth == 16 ? 2U : 1U);
    if (std::uint64_t{row_bytes} * height > kMaxUnpacked * job.to_read.size())
        png_error(from.png, "it is too short for the size that it says");
    job.read.frame = Frame(static_cast<int>(width), static_cast<int>(height), bits);
    job.rows.resize(height);
    for (std::size_t y = 0; y < height; ++y)
        job.rows[y] = reinterpret_cast<png_bytep>(job.read.frame.bytes().data()) + y * row_bytes;
    png_read_image(from.png, job.rows.data());
    png_read_end(from.png, from.info);
    png_textp texts = nullptr;
    const int count = png_get_text(from.png, from.info, &texts, nullptr);
    for (int k = 0; k < count; ++k) {
        if (keyword == texts[k].key) job.read.note.emplace(texts[k].text, texts[k].itxt_length);
    }
    job.done = true;
}

// Borrows the note's strings; png_set_text() copies them.
png_text text_of(const std::optional<PngNote>& note) {
    png_text text{};
    if (!note) return text;
    text.compression = PNG_ITXT_COMPRESSION_NONE;
    text.key = const_cast<char*>(note->keyword.c_str());
    text.text = const_cast<char*>(note->text.c_str());
    text.itxt_length = note->text.size();
    return text;
}

}  // namespace

Result<std::vector<std::uint8_t>> encode_grey_png(const FrameView& frame, const PngPacking& packing,
                                                  const std::optional<PngNote>& note) {
    if (frame.data == nullptr || frame.width_px <= 0 || frame.height_px <= 0)
        return fail(ErrorCode::invalid_argument, "the frame is empty");
    Job job;
    job.rows.reserve(static_cast<std::size_t>(frame.height_px));
    for (int y = 0; y < frame.height_px; ++y) {
        job.rows.push_back(reinterpret_cast<png_bytep>(const_cast<std::byte*>(frame.data + y * frame.stride_bytes)));
    }
    const Layout layout{.width_px = frame.width_px,
                        .height_px = frame.height_px,
                        .depth = frame.bits > 8 ? 16 : 8,
                        .significant_bits = note ? frame.bits : 0};
    png_text text = text_of(note);
    return encode(job, layout, packing, note ? &text : nullptr);
}

Result<std::vector<std::uint8_t>> encode_index_png(int width_px, int height_px, std::span<const std::uint8_t> indexes,
                                                   std::span<const PngColour> palette,
                                                   const std::optional<PngNote>& note) {
    const auto width = static_cast<std::size_t>(width_px);
    if (width_px <= 0 || height_px <= 0 || indexes.size() != width * static_cast<std::size_t>(height_px) ||
        palette.empty() || palette.size() > 256 || *std::ranges::max_element(indexes) >= palette.size()) {
        return fail(ErrorCode::invalid_argument,
                    "an image of " + std::to_string(width_px) + "x" + std::to_string(height_px) + " indexes into " +
                        std::to_string(palette.size()) + " colours cannot be made a PNG",
                    "report it");
    }
    std::vector<png_color> colours;
    for (const PngColour& c : palette) colours.push_back({c.red, c.green, c.blue});
    Job job;
    job.rows.reserve(static_cast<std::size_t>(height_px));
    for (std::size_t at = 0; at < indexes.size(); at += width)
        job.rows.push_back(const_cast<png_bytep>(indexes.data() + at));
    png_text text = text_of(note);
    return encode(job, {.width_px = width_px, .height_px = height_px, .palette = colours}, {}, note ? &text : nullptr);
}

Result<std::vector<std::uint8_t>> encode_bgr_png(int width_px, int height_px, std::span<const std::uint8_t> bgr) {
    const std::size_t row_bytes = 3 * static_cast<std::size_t>(width_px);
    if (width_px <= 0 || height_px <= 0 || bgr.size() != row_bytes * static_cast<std::size_t>(height_px)) {
        return fail(ErrorCode::invalid_argument,
                    "a picture of " + std::to_string(width_px) + "x" + std::to_string(height_px) + " pixels has " +
                        std::to_string(bgr.size()) + " bytes, and cannot be made a PNG",
                    "report it");
    }
    Job job;
    job.rows.reserve(static_cast<std::size_t>(height_px));
    for (std::size_t at = 0; at < bgr.size(); at += row_bytes)
        job.rows.push_back(const_cast<png_bytep>(bgr.data() + at));
    return encode(job, {.width_px = width_px, .height_px = height_px, .colour = true}, {}, nullptr);
}

Result<GreyPng> decode_grey_png(std::span<const std::uint8_t> bytes, std::string_view name,
                                const std::string& note_keyword, const AcceptSize& accept) {
    Job job;
    job.to_read = bytes;
    job.check_size = [&](std::uint32_t width, std::uint32_t height) {
        return check_declared_size(name, width, height, accept);
    };
    const Png reader(job, false);
    if (reader.info != nullptr) read_all(reader, job, note_keyword);
    if (job.not_grey != nullptr)
        return fail(ErrorCode::unsupported, std::string(name) + " is not a grey frame (" + job.not_grey + ")",
                    "save it as 8- or 16-bit grey PNG, TIFF or binary PGM, one channel");
    if (job.refused) return tl::unexpected(std::move(*job.refused));
    if (!job.done)
        return fail(ErrorCode::unreadable, std::string(name) + " is truncated or damaged (" + job.why + ")",
                    "record or copy it again");
    return std::move(job.read);
}

}  // namespace hord::common
