#include "algo/good_parts/distinct_parts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>

#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kMaxAreas = 32;  // along each axis
// Near: chi-square with two degrees of freedom over the whole field, 99.6 % of the repeated exposures are below; and
// standard deviations of the mean of squares over smaller areas.
constexpr double kNear = 11, kWhite = 8;
// Chi-squares grow with the square of the distance. If pairs within s times the near ones' distance grow as s^d, their
// numbers from 1 to sqrt 3 and from 1 to 3 times that distance give d, and so how many are near by chance. d is at
// least 2 (a part that lies aside) and is taken as at most 6.
constexpr double kThree = 3, kNine = 9, kMaxRatio = 1.0 / 3, kMinRatio = 1.0 / 27;
constexpr double kMinLight = 0.2;  // of the brightest area's: fainter areas are not compared

// A hash of the samples that is the same for all eight mirrored and turned copies: the sum over all samples of a hash
// of the value and of its distance from the middle.
std::uint64_t content_of(const FrameView& f) {
    std::uint64_t sum = 0;
    for (int y = 0; y < f.height_px; ++y) {
        const std::int64_t v = 2 * y - f.height_px + 1;
        for (int x = 0; x < f.width_px; ++x) {
            const std::int64_t u = 2 * x - f.width_px + 1;
            std::uint64_t mixed = (static_cast<std::uint64_t>(u * u + v * v) << 16U) ^ f.sample(x, y);
            mixed = (mixed ^ mixed >> 33U) * 0xFF51AFD7ED558CCDU;
            sum += (mixed ^ mixed >> 29U) * 0xC4CEB9FE1A85EC53U;
        }
    }
    return sum;
}

}  // namespace

DistinctParts::DistinctParts(const Extents& extents, std::uint32_t dark_dn)
    : extents_(extents), dark_dn_(dark_dn), side_((std::max(extents.m, extents.n) + kMaxAreas - 1) / kMaxAreas),
      columns_(extents.m / side_), rows_(extents.n / side_) {}

void DistinctParts::add(const FrameView& frame) {
    Shown shown;
    shown.content = content_of(frame);
    const Extents& e = extents_;
    for (int row = 0; row < rows_; ++row) {
        for (int column = 0; column < columns_; ++column) {
            double light = 0, x = 0, y = 0, squares = 0;
            for (int b = 0; b < e.bins(); ++b) {
                const int i = b % e.i, j = b / e.i;
                double here = 0;
                for (int n = row * side_; n < (row + 1) * side_; ++n) {
                    for (int m = column * side_; m < (column + 1) * side_; ++m) {
                        const std::uint32_t sample = frame.sample(m * e.i + i, n * e.j + j);
                        here += sample > dark_dn_ ? sample - dark_dn_ : 0;
                    }
                }
                const double u = i - 0.5 * (e.i - 1), v = j - 0.5 * (e.j - 1);
                light += here, x += here * u, y += here * v, squares += here * (u * u + v * v);
            }
            if (light > 0) x /= light, y /= light, squares = squares / light - x * x - y * y;
            shown.light.push_back(static_cast<float>(light));
            shown.x.push_back(static_cast<float>(x));
            shown.y.push_back(static_cast<float>(y));
            shown.spread.push_back(static_cast<float>(std::max(squares / 2, 0.05)));
        }
    }
    frames_.push_back(std::move(shown));
}

// The mean of squares of sums over side x side areas, over that of single areas: 1 for white noise. NaN: not compared.
double DistinctParts::white(const std::vector<double>& differences, int side) const {
    double squares = 0, cells = 0;
    for (int row = 0; row + side <= rows_; row += side) {
        for (int column = 0; column + side <= columns_; column += side) {
            double sum = 0, count = 0;
            for (int r = row; r < row + side; ++r) {
                for (int c = column; c < column + side; ++c) {
                    const double d = differences[static_cast<std::size_t>(r * columns_ + c)];
                    if (!std::isnan(d)) sum += d, count += 1;
                }
            }
            if (count > 0) squares += sum * sum / count, cells += 1;
        }
    }
    // In standard deviations above 1.
    return cells > 0 ? (squares / cells - 1) / std::sqrt(2 / cells) : 0;
}

DistinctParts::Distance DistinctParts::distance(const Shown& a, const Shown& b) const {
    double total_a = 0, total_b = 0, brightest = 0;
    for (std::size_t k = 0; k < a.light.size(); ++k) {
        total_a += static_cast<double>(a.light[k]), total_b += static_cast<double>(b.light[k]);
        brightest = std::max(brightest, static_cast<double>(a.light[k]));
    }
    Distance d;
    if (!(total_a > 0) || !(total_b > 0)) return {1e300, 1e300};
    const double brighter = total_a / total_b;
    std::array<std::vector<double>, 3> all;
    const double none = std::nan("");
    for (std::size_t k = 0; k < a.light.size(); ++k) {
        const auto la = static_cast<double>(a.light[k]), lb = static_cast<double>(b.light[k]);
        if (la < kMinLight * brightest || lb * brighter < kMinLight * brightest) {
            for (auto& values : all) values.push_back(none);
            continue;
        }
        const double noise = std::sqrt(static_cast<double>(a.spread[k]) / la + static_cast<double>(b.spread[k]) / lb);
        all[0].push_back((la - brighter * lb) / std::sqrt(la + brighter * brighter * lb));
        all[1].push_back(static_cast<double>(a.x[k] - b.x[k]) / noise);
        all[2].push_back(static_cast<double>(a.y[k] - b.y[k]) / noise);
    }
    for (std::size_t c = 0; c < all.size(); ++c) {
        // The noise of single areas, from the median difference of neighbours: what changes slowly is not noise.
        std::vector<double> steps;
        double count = 0;
        for (std::size_t k = 0; k < all[c].size(); ++k) {
            if (std::isnan(all[c][k])) continue;
            count += 1;
            if (k > 0 && !std::isnan(all[c][k - 1])) steps.push_back(std::abs(all[c][k] - all[c][k - 1]));
        }
        if (steps.size() < 9) return {1e300, 1e300};
        const double sigma = std::max(1.4826 / std::numbers::sqrt2 * common::quantile(std::move(steps), 0.5), 1e-9);
        double sum = 0;
        for (double& v : all[c]) {
            v /= sigma;
            if (!std::isnan(v)) sum += v;
        }
        if (c > 0) d.field += sum * sum / count;
        for (const int side : {1, 3, 9}) d.local = std::max(d.local, white(all[c], side));
    }
    return d;
}

DistinctParts::Groups DistinctParts::groups() const {
    Groups groups;
    std::vector<std::size_t> original(frames_.size());  // of each frame: the first of its copies
    std::vector<std::size_t> originals;
    std::map<std::uint64_t, std::size_t> contents;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
        const auto [at, is_new] = contents.try_emplace(frames_[k].content, originals.size());
        original[k] = at->second;
        if (is_new) originals.push_back(k);
        else ++groups.copies;
    }
    const std::size_t count = originals.size();
    struct Pair {
        double field;
        std::size_t a, b;
    };
    std::vector<Pair> near;
    std::vector<bool> is_near(count * count);
    double closer = 0, beyond = 0;  // pairs beyond the near ones, within sqrt 3 and 3 times their distance
    for (std::size_t a = 0; a < count; ++a) {
        for (std::size_t b = a + 1; b < count; ++b) {
            const Distance d = distance(frames_[originals[a]], frames_[originals[b]]);
            if (d.field < kNear && d.local < kWhite) {
                near.push_back({d.field, a, b});
                is_near[a * count + b] = is_near[b * count + a] = true;
            } else if (d.field < kNine * kNear && d.local < kNine * kWhite) {
                beyond += 1;
                if (d.field < kThree * kNear && d.local < kThree * kWhite) closer += 1;
            }
        }
    }
    std::vector<std::vector<std::size_t>> members(count);
    std::vector<std::size_t> group(count);
    std::iota(group.begin(), group.end(), std::size_t{0});
    for (std::size_t k = 0; k < count; ++k) members[k] = {k};
    // With q = 3^(-d/2): closer / beyond = q / (1 + q), and near / beyond = q^2 / (1 - q^2).
    const double share = closer / std::max(beyond, 1.0),
                 q = std::clamp(share / std::max(1 - share, 0.1), kMinRatio, kMaxRatio);
    const double by_chance = beyond * q * q / (1 - q * q), spread = std::sqrt(by_chance),
                 more = static_cast<double>(near.size()) - by_chance;
    double unseen = std::max(0.0, std::floor(more + 2 * spread));  // pairs that may be exposures of one part
    if (more > 3 * spread) {
        unseen = 0;
        // Groups are joined if most of their pairs are near: exposures with little light lie near other parts', too.
        std::ranges::sort(near, {}, &Pair::field);
        for (const Pair& pair : near) {
            const std::size_t a = std::min(group[pair.a], group[pair.b]), b = std::max(group[pair.a], group[pair.b]);
            if (a == b) continue;
            std::size_t close = 0;
            for (const std::size_t k : members[a]) {
                for (const std::size_t l : members[b]) close += is_near[k * count + l] ? 1U : 0U;
            }
            if (2 * close < members[a].size() * members[b].size()) continue;
            for (const std::size_t k : members[b]) group[k] = a;
            members[a].insert(members[a].end(), members[b].begin(), members[b].end());
            members[b].clear();
            ++groups.exposures;
        }
    }
    std::map<std::size_t, std::size_t> numbers;
    for (std::size_t k = 0; k < frames_.size(); ++k)
        groups.part_of.push_back(numbers.try_emplace(group[original[k]], numbers.size()).first->second);
    groups.parts = numbers.size();
    groups.at_least = groups.parts -
        std::min(groups.parts - std::min<std::size_t>(groups.parts, 1), static_cast<std::size_t>(unseen));
    return groups;
}

std::string describe(const DistinctParts::Groups& g) {
    if (g.parts == g.part_of.size()) return {};
    std::string text = std::to_string(g.part_of.size()) + " frames show " + std::to_string(g.parts) + " distinct part" +
        (g.parts == 1 ? "" : "s") + ": ";
    if (g.copies > 0)
        text +=
            std::to_string(g.copies) + (g.copies == 1 ? " is a copy of an earlier one" : " are copies of earlier ones");
    if (g.copies > 0 && g.exposures > 0) text += ", ";
    if (g.exposures > 0)
        text += std::to_string(g.exposures) +
            (g.exposures == 1 ? " differs from an earlier one" : " differ from earlier ones") +
            " by noise alone, as repeated exposures do";
    return text + ". Each part counts once.";
}

namespace {

// The dark level that the learner will choose (docs/notes/reference.md).
std::uint32_t dark_level(const LearnOptions& options) {
    if (!options.dark_from_noise) return options.levels.dark;
    const double level = static_cast<double>(options.pedestal_dn) + 3 * static_cast<double>(options.read_dn) - 0.5;
    return std::min(options.levels.dark, static_cast<std::uint32_t>(std::max(1.0, std::ceil(level))));
}

}  // namespace

Result<PartsToLearn> parts_to_learn(const Extents& extents, std::size_t count, const FrameOfPart& frame_of,
                                    const LearnOptions& options) {
    DistinctParts distinct(extents, dark_level(options));
    for (std::size_t k = 0; k < count; ++k) {
        const auto frame = frame_of(k);
        if (!frame) return tl::unexpected(frame.error());
        if (auto fine = check_frame(frame->view(), extents, frame->bits()); !fine) return tl::unexpected(fine.error());
        distinct.add(frame->view());
    }
    const DistinctParts::Groups groups = distinct.groups();
    PartsToLearn parts;
    parts.repeated = describe(groups);
    for (std::size_t k = 0; k < count; ++k) {
        if (groups.part_of[k] == parts.frames.size()) parts.frames.push_back(k);
    }
    if (groups.parts >= Reference::kMinParts) return parts;
    const std::string more = std::to_string(Reference::kMinParts - groups.parts);
    return fail(ErrorCode::invalid_argument,
                (parts.repeated.empty() ? std::to_string(count) + " frames to learn from." : parts.repeated) +
                    " A reference needs " + std::to_string(Reference::kMinParts) + " distinct good parts",
                "give frames of at least " + more + " more, each of another part or of one that was placed anew");
}

}  // namespace hord::algo
