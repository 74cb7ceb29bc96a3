#include "firmware/exchange/hdf5_file.h"

#include <algorithm>

#include <fmt/format.h>
#include <hdf5.h>

#include "common/file_writing.h"
#include "common/frame_size.h"

namespace hord::firmware {
namespace {

// An id of the library, closed at the end of its scope.
class Id {
  public:
    Id(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
    ~Id() {
        if (id_ >= 0) close_(id_);
    }
    Id(const Id&) = delete;
    Id& operator=(const Id&) = delete;
    operator hid_t() const { return id_; }  // NOLINT(google-explicit-constructor)
    [[nodiscard]] bool good() const { return id_ >= 0; }

  private:
    hid_t id_;
    herr_t (*close_)(hid_t);
};

// The library prints its errors; a caller gets ours instead.
void be_quiet() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

hid_t type_in_file(ArrayType type) {
    return type == ArrayType::uint8 ? H5T_STD_U8LE : type == ArrayType::uint16 ? H5T_STD_U16LE : H5T_IEEE_F32LE;
}
hid_t type_in_memory(ArrayType type) {
    return type == ArrayType::uint8 ? H5T_NATIVE_UINT8
        : type == ArrayType::uint16 ? H5T_NATIVE_UINT16
                                    : H5T_NATIVE_FLOAT;
}

bool write_attributes(hid_t to, const Attributes& attributes) {
    for (const auto& [name, text] : attributes) {
        const Id type(H5Tcopy(H5T_C_S1), H5Tclose);
        const Id space(H5Screate(H5S_SCALAR), H5Sclose);
        if (H5Tset_size(type, std::max<std::size_t>(text.size(), 1)) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0)
            return false;
        const Id attribute(H5Acreate2(to, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
        if (!attribute.good() || H5Awrite(attribute, type, text.empty() ? " " : text.c_str()) < 0) return false;
    }
    return true;
}

bool write_dataset(hid_t file, const Dataset& dataset) {
    std::vector<hsize_t> shape(dataset.array.shape.begin(), dataset.array.shape.end());
    const Id space(H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr), H5Sclose);
    const Id groups(H5Pcreate(H5P_LINK_CREATE), H5Pclose);
    if (!space.good() || H5Pset_create_intermediate_group(groups, 1) < 0) return false;
    const Id to(H5Dcreate2(file, dataset.path.c_str(), type_in_file(dataset.array.type), space, groups, H5P_DEFAULT,
                           H5P_DEFAULT),
                H5Dclose);
    return to.good() &&
        H5Dwrite(to, type_in_memory(dataset.array.type), H5S_ALL, H5S_ALL, H5P_DEFAULT, dataset.array.bytes.data()) >=
        0 &&
        write_attributes(to, dataset.attributes);
}

// The whole file in memory.
Result<std::vector<std::uint8_t>> encode(const std::vector<Dataset>& datasets, const Attributes& attributes) {
    const auto failed = [] { return fail(ErrorCode::internal, "the arrays cannot be made an HDF5 file", "report it"); };
    const Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    if (H5Pset_fapl_core(access, std::size_t{1} << 20U, 0) < 0) return failed();
    const Id file(H5Fcreate("in memory", H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose);
    if (!file.good() || !write_attributes(file, attributes)) return failed();
    for (const Dataset& dataset : datasets) {
        if (!write_dataset(file, dataset)) return failed();
    }
    if (H5Fflush(file, H5F_SCOPE_GLOBAL) < 0) return failed();
    const ssize_t size = H5Fget_file_image(file, nullptr, 0);
    if (size <= 0) return failed();
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
    if (H5Fget_file_image(file, bytes.data(), bytes.size()) != size) return failed();
    return bytes;
}

}  // namespace

Result<void> write_hdf5(const std::filesystem::path& file, const std::vector<Dataset>& datasets,
                        const Attributes& attributes) {
    be_quiet();
    return encode(datasets, attributes).and_then([&](const auto& bytes) {
        return common::write_atomically(file, bytes);
    });
}

Result<Array> read_hdf5(const std::filesystem::path& file, const std::string& dataset) {
    be_quiet();
    const std::string name = file.string();
    const Id opened(H5Fopen(name.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    if (!opened.good()) return fail(ErrorCode::unreadable, name + " is no HDF5 file, or is damaged", "save it again");
    const Id from(H5Dopen2(opened, dataset.c_str(), H5P_DEFAULT), H5Dclose);
    if (!from.good())
        return fail(ErrorCode::not_found, fmt::format("{} has no dataset {}", name, dataset),
                    "give a file with a light field");
    const Id type(H5Dget_type(from), H5Tclose);
    const Id space(H5Dget_space(from), H5Sclose);
    const std::size_t size = H5Tget_size(type);
    if (H5Tget_class(type) != H5T_INTEGER || H5Tget_sign(type) != H5T_SGN_NONE || (size != 1 && size != 2)) {
        return fail(ErrorCode::unsupported, fmt::format("{}: {} holds no uint8 and no uint16", name, dataset),
                    "save samples as uint8 or uint16");
    }
    Array array;
    array.type = size == 1 ? ArrayType::uint8 : ArrayType::uint16;
    const int dimensions = H5Sget_simple_extent_ndims(space);
    if (dimensions < 1 || dimensions > 8)
        return fail(ErrorCode::unsupported, fmt::format("{}: {} has {} dimensions", name, dataset, dimensions),
                    "give a file with a light field");
    std::vector<hsize_t> shape(static_cast<std::size_t>(dimensions));
    H5Sget_simple_extent_dims(space, shape.data(), nullptr);
    std::uint64_t count = 1;
    for (const hsize_t side : shape) {
        // Colour has four channels.
        if (side == 0 || count > 4 * common::kMaxFrameSamples / side) {
            return fail(ErrorCode::unsupported, fmt::format("{}: {} is empty, or larger than a frame", name, dataset),
                        "give a file with one light field");
        }
        count *= side;
        array.shape.push_back(static_cast<std::size_t>(side));
    }
    array.bytes.resize(count * size);
    if (H5Dread(from, type_in_memory(array.type), H5S_ALL, H5S_ALL, H5P_DEFAULT, array.bytes.data()) < 0)
        return fail(ErrorCode::unreadable, fmt::format("{}: {} is damaged", name, dataset), "save it again");
    return array;
}

}  // namespace hord::firmware
