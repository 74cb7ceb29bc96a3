#include "firmware/store/frame_png.h"

#include <csetjmp>
#include <cstring>
#include <fstream>

#include <png.h>

#include "firmware/store/chain.h"

namespace hord::firmware::store {
namespace {

constexpr char kKeyword[] = "hord";

// What libpng is given and gives back. It leaves by longjmp, past any destructor: so everything that it works on lives here,
// outside of the functions that call it.
struct Job {
    std::vector<std::uint8_t>* written = nullptr;
    std::span<const std::uint8_t> to_read;
    std::size_t at = 0;
    std::string why;
    std::vector<png_bytep> rows;
    algo::Frame frame;
    std::string metadata;
    bool has_metadata = false;
};

void on_error(png_structp png, png_const_charp why) {
    static_cast<Job*>(png_get_error_ptr(png))->why = why;
    png_longjmp(png, 1);
}
void on_warning(png_structp /*png*/, png_const_charp /*why*/) {}

void on_write(png_structp png, png_bytep bytes, std::size_t count) {
    auto& written = *static_cast<Job*>(png_get_io_ptr(png))->written;
    written.insert(written.end(), bytes, bytes + count);
}
void on_flush(png_structp /*png*/) {}

void on_read(png_structp png, png_bytep bytes, std::size_t count) {
    auto& job = *static_cast<Job*>(png_get_io_ptr(png));
    if (job.to_read.size() - job.at < count) png_error(png, "it is cut off");
    std::memcpy(bytes, job.to_read.data() + job.at, count);
    job.at += count;
}

bool write_all(png_structp png, png_infop info, Job& job, const algo::FrameView& frame, std::string& metadata, int level) {
    if (setjmp(png_jmpbuf(png)) != 0) return false;
    png_set_write_fn(png, &job, on_write, on_flush);
    png_set_compression_level(png, level);
    png_set_filter(png, 0, PNG_FILTER_SUB);
    png_set_IHDR(png, info, static_cast<png_uint_32>(frame.width_px), static_cast<png_uint_32>(frame.height_px), frame.bits > 8 ? 16 : 8,
                 PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_color_8 depth{};
    depth.gray = static_cast<png_byte>(frame.bits);
    png_set_sBIT(png, info, &depth);
    png_text text{};
    text.compression = PNG_ITXT_COMPRESSION_NONE;
    text.key = const_cast<char*>(kKeyword);
    text.text = metadata.data();
    text.itxt_length = metadata.size();
    png_set_text(png, info, &text, 1);
    png_write_info(png, info);
    if (frame.bits > 8) png_set_swap(png);
    png_write_image(png, job.rows.data());
    png_write_end(png, info);
    return true;
}

bool read_all(png_structp png, png_infop info, Job& job) {
    if (setjmp(png_jmpbuf(png)) != 0) return false;
    png_set_read_fn(png, &job, on_read);
    png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
    png_read_info(png, info);
    const int depth = png_get_bit_depth(png, info);
    if (png_get_color_type(png, info) != PNG_COLOR_TYPE_GRAY || (depth != 8 && depth != 16)) png_error(png, "it is not a grey frame of 8 or 16 bits");
    int bits = depth;
    png_color_8p significant = nullptr;
    if (png_get_sBIT(png, info, &significant) != 0 && depth == 16 && significant->gray > 8 && significant->gray <= 16) bits = significant->gray;
    if (depth == 16) png_set_swap(png);
    const auto width = png_get_image_width(png, info), height = png_get_image_height(png, info);
    if (width > 65'536 || height > 65'536) png_error(png, "it is larger than any sensor");
    job.frame = algo::Frame(static_cast<int>(width), static_cast<int>(height), bits);
    const std::size_t row_bytes = static_cast<std::size_t>(width) * (depth == 16 ? 2U : 1U);
    job.rows.resize(height);
    for (std::size_t y = 0; y < height; ++y) job.rows[y] = reinterpret_cast<png_bytep>(job.frame.bytes().data()) + y * row_bytes;
    png_read_image(png, job.rows.data());
    png_read_end(png, info);
    png_textp texts = nullptr;
    const int count = png_get_text(png, info, &texts, nullptr);
    for (int k = 0; k < count; ++k) {
        if (std::strcmp(texts[k].key, kKeyword) != 0) continue;
        job.metadata.assign(texts[k].text, texts[k].itxt_length);
        job.has_metadata = true;
    }
    return true;
}

}  // namespace

Result<std::vector<std::uint8_t>> encode_png(const algo::FrameView& frame, std::string_view metadata, int level) {
    if (frame.data == nullptr || frame.width_px <= 0 || frame.height_px <= 0) return fail(ErrorCode::invalid_argument, "the frame is empty");
    Job job;
    std::vector<std::uint8_t> bytes;
    job.written = &bytes;
    for (int y = 0; y < frame.height_px; ++y) {
        job.rows.push_back(reinterpret_cast<png_bytep>(const_cast<std::byte*>(frame.data + y * frame.stride_bytes)));
    }
    std::string text(metadata);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
    png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
    const bool good = info != nullptr && write_all(png, info, job, frame, text, level);
    png_destroy_write_struct(&png, &info);
    if (!good) return fail(ErrorCode::internal, "the frame cannot be made a PNG (" + job.why + ")", "report it");
    return bytes;
}

Result<AnnotatedFrame> decode_png(std::span<const std::uint8_t> bytes, const std::string& name) {
    Job job;
    job.to_read = bytes;
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
    png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
    const bool good = info != nullptr && read_all(png, info, job);
    png_destroy_read_struct(&png, &info, nullptr);
    const auto unreadable = [&](const std::string& why) {
        return fail(ErrorCode::unreadable, name + " is damaged (" + why + ")", "leave it out; nothing of it can be trusted");
    };
    if (!good) return unreadable(job.why);
    if (job.at != bytes.size()) return unreadable("something follows its end");
    if (!job.has_metadata) return fail(ErrorCode::unreadable, name + " says nothing of its part", "name frames that a station has kept");
    return AnnotatedFrame{std::move(job.frame), std::move(job.metadata)};
}

Result<AnnotatedFrame> read_annotated_frame(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    if (!in) return fail(ErrorCode::not_found, file.string() + " cannot be read", "check the path and its permissions");
    const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
    return decode_png(bytes, file.string());
}

std::string digest_of_samples(const algo::FrameView& frame) {
    std::vector<std::uint8_t> samples;
    const auto row_bytes = static_cast<std::size_t>(frame.width_px) * static_cast<std::size_t>(frame.sample_bytes());
    samples.reserve(row_bytes * static_cast<std::size_t>(frame.height_px));
    for (int y = 0; y < frame.height_px; ++y) {
        const auto* row = reinterpret_cast<const std::uint8_t*>(frame.data + y * frame.stride_bytes);
        samples.insert(samples.end(), row, row + row_bytes);
    }
    return to_hex(sha256(samples));
}

}  // namespace hord::firmware::store
