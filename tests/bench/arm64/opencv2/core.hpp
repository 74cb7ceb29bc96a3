// Stands in for OpenCV where it is not installed for arm64: what algo/inspection/defects.cpp uses of it.
#pragma once

#include <cstddef>
#include <exception>
#include <vector>

constexpr int CV_32S = 4;

namespace cv {

struct Exception : std::exception {};
inline void setNumThreads(int) {}

template <class T>
struct Mat_ {
    int rows = 0, cols = 0;
    T* data = nullptr;
    std::vector<T> values;
    Mat_() = default;
    Mat_(int r, int c) { create(r, c); }
    void create(int r, int c) {
        rows = r, cols = c;
        values.resize(static_cast<std::size_t>(r) * static_cast<std::size_t>(c));
        data = values.data();
    }
    T& operator()(int y, int x) { return data[static_cast<std::ptrdiff_t>(y) * cols + x]; }
    const T& operator()(int y, int x) const { return data[static_cast<std::ptrdiff_t>(y) * cols + x]; }
};
using Mat1b = Mat_<unsigned char>;
using Mat1i = Mat_<int>;
struct Mat {};

}  // namespace cv
