// What pictures of this folder are drawn with: colours, sizes, text. Needs OpenCV; for sources of this folder alone.
#pragma once

#include <string>

#include <opencv2/core.hpp>

#include "firmware/diagnostics/pictures.h"

namespace hord::firmware {

constexpr int kTitleHeight = 26;  // px, above a map or a frame
const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kPaper(255, 255, 255);
const cv::Scalar kMark(40, 40, 230);  // of defects and limits

// The least whole factor that makes at least 444 px of `side` lenslets, those of a map's longer side.
int enlargement(int side);

// A length in pixels at letters of this size (1: the usual one).
int scaled(int px, float letters);

void write_text(cv::Mat& image, const std::string& text, cv::Point at, double size, const cv::Scalar& colour = kInk);

// Largest text size up to `size` at which `text` fits into `width` pixels.
double fitting(const std::string& text, int width, double size);

Picture to_picture(const cv::Mat& image);

}  // namespace hord::firmware
