// What is told of a part that was not registered.
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "algo/reference/registration.h"

namespace hord::algo {

static_assert(kFarthestLenslets == 2.5 && kFarthestByEdges == 10 && kFarthestSine == 0.06, "as the sentences say");

const char* explain(Registered::Outcome outcome) {
    switch (outcome) {
        case Registered::Outcome::found: return "it lies where the reference's parts do";
        case Registered::Outcome::too_little: return "too little of it is seen to find where it lies";
        case Registered::Outcome::too_far:
            return "it lies more than 2.5 lenslets or 3.4 degrees from the reference's pose (10 lenslets are allowed "
                   "where its edges are found): lay it closer, or learn from parts that lie like it";
        case Registered::Outcome::foreign: return "it does not look like the reference's parts";
        case Registered::Outcome::other_edges:
            return "its edges are not where the reference's parts have theirs: lay it within 2.5 lenslets and 3.4 "
                   "degrees of them, or see whether it is another part";
        case Registered::Outcome::no_part:
            return "the field shows no edges, and the reference's parts have some: check that the part was there, the "
                   "trigger's delay, and that it is the reference's part";
        case Registered::Outcome::free_light:
            return "the light is nearer to an empty field's than to that of the reference's parts, in the whole field "
                   "or "
                   "a quarter of it: check that the part was there and whole, the trigger's delay, and that the light "
                   "is "
                   "as even as where the reference was learned";
        case Registered::Outcome::other_size:
            return "its opposite edges do not lie as far apart as those of the reference's parts: see whether it is "
                   "another part, or learn from good parts of its size, too";
        case Registered::Outcome::blurred:
            return "its edges are softer than those of the reference's parts: look for a part that moves while the "
                   "light is on (a shorter flash) or that is exposed twice, and see that it lies in the measurement "
                   "plane";
        case Registered::Outcome::unsettled:
            return "where it lies cannot be settled: see whether it is the reference's part and whole, or learn again "
                   "from parts that lie within half a lenslet of each other";
    }
    return "";
}

namespace {

std::string of_other_size(const SizeDifference& size) {
    const std::size_t axis = size.exceeds(0) ? 0 : 1;
    std::array<char, 280> text{};
    std::snprintf(text.data(), text.size(),
                  "its opposite edges lie %.2f lenslets %s along %s than those of the reference's parts (%.2f are "
                  "allowed): see whether it is another part, or learn from good parts of its size, too",
                  std::abs(size.wider[axis]), size.wider[axis] > 0 ? "farther apart" : "closer together",
                  axis == 0 ? "x" : "y", size.allowed[axis]);
    return text.data();
}

std::string of_blur(const EdgeBlur& blur) {
    const std::size_t axis = blur.exceeds(0) ? 0 : 1;
    std::array<char, 80> text{};
    std::snprintf(text.data(), text.size(), " (along %s by %.2f, %.2f are allowed)", axis == 0 ? "x" : "y",
                  blur.blur[axis], blur.allowed[axis]);
    std::string sentence = explain(Registered::Outcome::blurred);
    return sentence.insert(sentence.find(':'), text.data());
}

}  // namespace

std::string explain(const Registered& of) {
    if (of.outcome == Registered::Outcome::blurred && of.blur.exceeds()) return of_blur(of.blur);
    if (of.outcome == Registered::Outcome::other_size && of.size.exceeds()) return of_other_size(of.size);
    if (of.outcome != Registered::Outcome::too_far || of.missing_edges > kForeignShare) return explain(of.outcome);
    const bool by_edges = of.farthest[0] > kFarthestLenslets || of.farthest[1] > kFarthestLenslets;
    std::array<char, 200> lies{}, allowed{};
    std::snprintf(lies.data(), lies.size(),
                  "it lies %.1f lenslets along x and %.1f along y from the reference's pose, turned by %.1f degrees",
                  of.pose.x, of.pose.y, of.pose.turn_rad() * 180 / std::numbers::pi);
    std::snprintf(allowed.data(), allowed.size(), "%g lenslets along x, %g along y if its edges are found there,",
                  of.farthest[0], of.farthest[1]);
    return std::string(lies.data()) + " (" + (by_edges ? allowed.data() : "2.5 lenslets") +
        " and 3.4 degrees are allowed): lay it closer, or learn from parts that lie like it";
}

}  // namespace hord::algo
